#include "mapp/client/participant.h"

#include "fragment_session.h"
#include "mapp/base/check.h"
#include "mapp/base/mutex.h"
#include "mapp/codec/keyframe_codec.h"
#include "session_figures.h"
#include "tile_folder.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace mapp {
namespace {

using std::chrono::steady_clock;

/// A fragment of fewer was a moment's mistake: the server could never tell its place.
constexpr size_t kMinKeyframesToOpen = 2;
/// Sessions kept, the present one among them: each has its threads and its connection, and up to a full queue while the
/// server is away.
constexpr size_t kMaxFollowed = 17;
/// Less would hold few tiles, or none.
constexpr uint64_t kMinSharedMapBytes = 64 << 10;
constexpr uint64_t kMinCacheBytes = 1 << 20;

Status CheckRange(double value, double low, double high, const char* field) {
  if (value >= low && value <= high) return absl::OkStatus();
  return absl::InvalidArgumentError(fmt::format("{}: must be in [{}, {}], got {}", field, low, high, value));
}

}  // namespace

Status ParticipantOptions::Validate() const {
  if (map_name.empty()) return absl::InvalidArgumentError("map_name: must be set");
  if (device.empty()) return absl::InvalidArgumentError("device: must be set");
  MAPP_RETURN_IF_ERROR(features.Validate());
  MAPP_RETURN_IF_ERROR(CheckRange(num_samples, 1, 1000, "num_samples"));
  MAPP_RETURN_IF_ERROR(CheckRange(seen_overlap, std::nextafter(0.0, 1.0), 1, "seen_overlap"));
  MAPP_RETURN_IF_ERROR(CheckRange(min_seen_by_others, 0, 1, "min_seen_by_others"));
  MAPP_RETURN_IF_ERROR(CheckRange(oversharing, 1, 4, "oversharing"));
  MAPP_RETURN_IF_ERROR(CheckRange(max_shared_map_tries, 0, 100, "max_shared_map_tries"));
  MAPP_RETURN_IF_ERROR(CheckRange(look_ahead_m, 0, 100, "look_ahead_m"));
  if (max_shared_map_bytes != 0 && max_shared_map_bytes < kMinSharedMapBytes) {
    return absl::InvalidArgumentError(
        fmt::format("max_shared_map_bytes: must be 0, for no limit, or at least {}, got {}", kMinSharedMapBytes,
                    max_shared_map_bytes));
  }
  if (!tile_cache.folder.empty() && tile_cache.max_bytes < kMinCacheBytes) {
    return absl::InvalidArgumentError(
        fmt::format("tile_cache.max_bytes: must be at least {}, got {}", kMinCacheBytes, tile_cache.max_bytes));
  }
  if (max_queued_keyframes == 0) return absl::InvalidArgumentError("max_queued_keyframes: must be at least 1");
  return absl::OkStatus();
}

KeyframeTotals KeyframeTotals::Of(const Keyframe& keyframe) {
  const auto has_point = [](const KeyframeFeature& feature) { return feature.point.has_value(); };
  return {.num_keyframes = 1,
          .bytes = EncodeKeyframe(keyframe).size(),
          .num_features = keyframe.features.size(),
          .num_points = static_cast<uint64_t>(std::ranges::count_if(keyframe.features, has_point))};
}

KeyframeTotals& KeyframeTotals::operator+=(const KeyframeTotals& other) {
  num_keyframes += other.num_keyframes;
  bytes += other.bytes;
  num_features += other.num_features;
  num_points += other.num_points;
  return *this;
}

struct Participant::Impl {
  Impl(const SessionSetup& with_setup, SlamAdapter* with_adapter) : setup(with_setup), adapter(with_adapter) {}

  std::shared_ptr<FragmentSession> present() const {
    MutexLock lock(mutex);
    return followed.back();
  }
  std::vector<std::shared_ptr<FragmentSession>> Followed() const {
    MutexLock lock(mutex);
    return followed;
  }
  /// Makes `session` the present one. Keeps of the oldest beyond the limit, which has stopped, what it came to.
  void Push(std::shared_ptr<FragmentSession> session) {
    MutexLock lock(mutex);
    followed.push_back(std::move(session));
    if (closing) followed.back()->BeginClose();
    if (followed.size() <= kMaxFollowed) return;
    forgotten.push_back(followed.front()->Describe());
    forgotten_figures += followed.front()->figures();
    followed.erase(followed.begin());
  }

  const SessionSetup setup;
  SlamAdapter* const adapter;

  mutable Mutex mutex;
  bool closing ABSL_GUARDED_BY(mutex) = false;
  std::vector<std::shared_ptr<FragmentSession>> followed ABSL_GUARDED_BY(mutex);  // the present one last
  std::vector<ParticipantFragment> forgotten ABSL_GUARDED_BY(mutex);              // those before, as they were last
  SessionFigures forgotten_figures ABSL_GUARDED_BY(mutex);
};

StatusOr<std::unique_ptr<Participant>> Participant::Open(const MapClientOptions& client_options,
                                                         const ParticipantOptions& options, const Camera& camera,
                                                         SensorKind sensor, SlamAdapter* adapter) {
  MAPP_RETURN_IF_ERROR(options.Validate());
  MAPP_RETURN_IF_ERROR(camera.Validate());
  if (adapter == nullptr && options.policy != UploadPolicy::kUploadAll) {
    return absl::InvalidArgumentError("adapter: must be given, except with kUploadAll");
  }
  if (!options.tile_cache.folder.empty()) MAPP_RETURN_IF_ERROR(TileFolder::CheckUsable(options.tile_cache));
  MAPP_ASSIGN_OR_RETURN(std::unique_ptr<MapClient> client, MapClient::Create(client_options));
  const SessionSetup setup{client_options, options, camera, sensor};
  auto first = std::make_shared<FragmentSession>(std::move(client), setup, adapter, /*min_to_open=*/0);
  MAPP_RETURN_IF_ERROR(first->Open());
  auto impl = std::make_unique<Impl>(setup, adapter);
  impl->Push(std::move(first));
  return std::unique_ptr<Participant>(new Participant(std::move(impl)));
}

Participant::Participant(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Participant::~Participant() = default;

void Participant::OnKeyframe(Keyframe keyframe) {
  if (!keyframe.raster) keyframe.raster = RasterOf(keyframe, impl_->setup.camera);
  impl_->present()->OnKeyframe(std::move(keyframe));
}

void Participant::OnSharedMapFrame(const SharedMapFrame& frame,
                                   const std::function<std::optional<Keyframe>()>& last_keyframe) {
  impl_->present()->OnSharedMapFrame(frame, last_keyframe);
}

void Participant::BeginFragment() {
  StatusOr<std::unique_ptr<MapClient>> client = MapClient::Create(impl_->setup.client);
  MAPP_CHECK(client.ok());  // the options have served before
  auto next = std::make_shared<FragmentSession>(*std::move(client), impl_->setup, impl_->adapter, kMinKeyframesToOpen);
  const std::vector<std::shared_ptr<FragmentSession>> sessions = impl_->Followed();
  sessions.back()->EndFragment();
  if (sessions.size() == kMaxFollowed) sessions.front()->Stop();
  impl_->Push(next);
  next->OpenInBackground();
}

ParticipantState Participant::state() const { return impl_->present()->state(); }
std::optional<Pose3> Participant::T_map_session() const { return impl_->present()->T_map_session(); }
std::optional<Sim3> Participant::S_map_session() const { return impl_->present()->S_map_session(); }
std::optional<SessionId> Participant::session() const { return impl_->present()->session(); }

std::vector<ParticipantFragment> Participant::fragments() const {
  MutexLock lock(impl_->mutex);
  std::vector<ParticipantFragment> fragments = impl_->forgotten;
  for (const auto& session : impl_->followed) fragments.push_back(session->Describe());
  return fragments;
}

StatusOr<std::vector<std::vector<ClientKeyframePose>>> Participant::FetchKeyframePoses() {
  std::vector<std::shared_ptr<FragmentSession>> sessions;
  std::vector<std::vector<ClientKeyframePose>> poses;
  {
    MutexLock lock(impl_->mutex);
    sessions = impl_->followed;
    poses.resize(impl_->forgotten.size());
  }
  for (const auto& session : sessions) {
    MAPP_ASSIGN_OR_RETURN(poses.emplace_back(), session->FetchKeyframePoses());
  }
  return poses;
}

Status Participant::WaitIdle(std::chrono::milliseconds timeout) {
  const auto deadline = steady_clock::now() + timeout;
  const std::vector<std::shared_ptr<FragmentSession>> sessions = impl_->Followed();
  for (size_t i = 0; i + 1 < sessions.size(); ++i) {
    MAPP_RETURN_IF_ERROR(sessions[i]->WaitEnded(deadline));
  }
  return sessions.back()->WaitIdle(deadline);
}

Status Participant::Close(std::chrono::milliseconds timeout, bool wait_for_optimization) {
  const auto deadline = steady_clock::now() + timeout;
  {
    MutexLock lock(impl_->mutex);
    impl_->closing = true;
  }
  const std::vector<std::shared_ptr<FragmentSession>> sessions = impl_->Followed();
  sessions.back()->BeginClose();
  Status first_error;
  for (const auto& session : sessions) {
    const Status closed = session->Close(deadline, wait_for_optimization);
    if (first_error.ok()) first_error = closed;
  }
  return first_error;
}

ParticipantStats Participant::stats() const {
  MutexLock lock(impl_->mutex);
  SessionFigures figures = impl_->forgotten_figures;
  for (const auto& session : impl_->followed) figures += session->figures();
  return figures.Summary();
}

}  // namespace mapp
