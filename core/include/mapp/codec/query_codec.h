#pragma once

#include "mapp/base/status.h"
#include "mapp/geometry/pose3.h"
#include "mapp/map/keyframe.h"
#include "mapp/view/overlap.h"

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace mapp {

/// What a device tells of a view when it asks whether the map knows it: packed to at most 43 bytes, so that
/// OverlapQuery {C, K, P_q} fits in 64 (docs/formats/query.md).
struct ViewQuery {
  PoseFrame pose_frame = PoseFrame::kSession;
  Pose3 T_frame_camera;
  SamplerKind sampler = SamplerKind::kDepthSketch;
  DepthSketch sketch;  ///< not sent with kUniform
};

/// Position as three floats, rotation as the three smallest quaternion components in 16 bits each (0.005 degrees).
std::string EncodeViewQuery(const ViewQuery& query);
/// INVALID_ARGUMENT naming the field.
StatusOr<ViewQuery> DecodeViewQuery(std::string_view bytes);

/// REDUNDANT/FRESH of every sample (PT of the paper's response), listing the smaller class: the shorter of a bit mask
/// and gap-coded indices, at most num_samples / 8 + 4 bytes.
std::string EncodeSampleStates(const std::vector<bool>& redundant);
/// INVALID_ARGUMENT when the bytes do not describe exactly `num_samples` samples.
StatusOr<std::vector<bool>> DecodeSampleStates(std::string_view bytes, size_t num_samples);

/// Sample states or occupied bins, whichever the answer holds.
std::string EncodeOverlapAnswer(const OverlapAnswer& answer);
/// The answer to `query`. INVALID_ARGUMENT when the bytes are not one.
StatusOr<OverlapAnswer> DecodeOverlapAnswer(std::string_view bytes, const ViewQuery& query, size_t num_samples);

}  // namespace mapp
