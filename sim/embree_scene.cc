#include "sim/embree_scene.h"

#include "mapp/base/check.h"

#include <array>
#include <embree3/rtcore.h>
#include <memory>
#include <type_traits>

namespace mapp::sim {
namespace {

struct DeviceRelease {
  void operator()(RTCDevice device) const { rtcReleaseDevice(device); }
};

/// One for the program. Scenes are built by the thread that asks: they are small, and Embree's helper threads would
/// compete with those that draw.
RTCDevice SharedDevice() {
  static const std::unique_ptr<std::remove_pointer_t<RTCDevice>, DeviceRelease> device(rtcNewDevice("threads=1"));
  MAPP_CHECK(device != nullptr);
  return device.get();
}

void FillBuffers(std::span<const Quad> quads, RTCGeometry geometry) {
  auto* vertices = static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                                               3 * sizeof(float), 4 * quads.size()));
  auto* indices = static_cast<uint32_t*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT4,
                                                                 4 * sizeof(uint32_t), quads.size()));
  MAPP_CHECK(vertices != nullptr && indices != nullptr);
  uint32_t next_vertex = 0;
  for (const Quad& quad : quads) {
    const std::array<Eigen::Vector3d, 4> outline = {quad.corner_world, quad.corner_world + quad.edge_v_world,
                                                    quad.corner_world + quad.edge_v_world + quad.edge_u_world,
                                                    quad.corner_world + quad.edge_u_world};
    for (const Eigen::Vector3d& p_world : outline) {
      for (int axis = 0; axis < 3; ++axis) *vertices++ = static_cast<float>(p_world[axis]);
      *indices++ = next_vertex++;
    }
  }
}

}  // namespace

EmbreeScene::EmbreeScene(std::span<const Quad> quads, uint32_t geometry_id, Lifetime lifetime)
    : scene_(rtcNewScene(SharedDevice())) {
  MAPP_CHECK(scene_ != nullptr);
  // Without this, rays slip through the seams of surfaces that share an edge.
  rtcSetSceneFlags(scene_, RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION);
  rtcSetSceneBuildQuality(scene_, lifetime == Lifetime::kLong ? RTC_BUILD_QUALITY_HIGH : RTC_BUILD_QUALITY_LOW);
  if (!quads.empty()) {
    RTCGeometry geometry = rtcNewGeometry(SharedDevice(), RTC_GEOMETRY_TYPE_QUAD);
    MAPP_CHECK(geometry != nullptr);
    FillBuffers(quads, geometry);
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(scene_, geometry, geometry_id);
    rtcReleaseGeometry(geometry);
  }
  rtcCommitScene(scene_);
  MAPP_CHECK(rtcGetDeviceError(SharedDevice()) == RTC_ERROR_NONE);
}

EmbreeScene::~EmbreeScene() { rtcReleaseScene(scene_); }

void EmbreeScene::RejectBacks(const RTCFilterFunctionNArguments* arguments) {
  // Embree's normal is ours, edge_v x edge_u, by the order of the vertices.
  RTCRayN* ray = arguments->ray;
  RTCHitN* hit = arguments->hit;
  const unsigned int n = arguments->N;
  for (unsigned int i = 0; i < n; ++i) {
    if (arguments->valid[i] == 0) continue;
    const float along_normal = RTCRayN_dir_x(ray, n, i) * RTCHitN_Ng_x(hit, n, i) +
                               RTCRayN_dir_y(ray, n, i) * RTCHitN_Ng_y(hit, n, i) +
                               RTCRayN_dir_z(ray, n, i) * RTCHitN_Ng_z(hit, n, i);
    if (!(along_normal < 0)) arguments->valid[i] = 0;
  }
}

}  // namespace mapp::sim
