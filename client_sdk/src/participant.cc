#include "mapp/client/participant.h"

#include "mapp/codec/keyframe_codec.h"
#include "network_worker.h"
#include "session_progress.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <thread>
#include <utility>

namespace mapp {
namespace {

using std::chrono::steady_clock;

Status CheckRange(double value, double low, double high, const char* field) {
  if (value >= low && value <= high) return absl::OkStatus();
  return absl::InvalidArgumentError(fmt::format("{}: must be in [{}, {}], got {}", field, low, high, value));
}

}  // namespace

Status ParticipantOptions::Validate() const {
  if (map_name.empty()) return absl::InvalidArgumentError("map_name: must be set");
  if (device.empty()) return absl::InvalidArgumentError("device: must be set");
  MAPP_RETURN_IF_ERROR(CheckRange(num_samples, 1, 1000, "num_samples"));
  MAPP_RETURN_IF_ERROR(CheckRange(seen_overlap, std::nextafter(0.0, 1.0), 1, "seen_overlap"));
  MAPP_RETURN_IF_ERROR(CheckRange(min_seen_by_others, 0, 1, "min_seen_by_others"));
  MAPP_RETURN_IF_ERROR(CheckRange(oversharing, 1, 4, "oversharing"));
  MAPP_RETURN_IF_ERROR(CheckRange(max_shared_map_tries, 0, 100, "max_shared_map_tries"));
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
  Impl(std::unique_ptr<MapClient> c, const ParticipantOptions& options, const ClientSession& s, const Camera& cam,
       SlamAdapter* adapter)
      : client(std::move(c)),
        session(s),
        camera(cam),
        progress(options.max_queued_keyframes),
        worker(*client, progress, adapter, options, session, camera),
        watch(client->WatchSession(session.id, [this](const ClientEvent& event) { progress.OnEvent(event); })),
        thread([this] { worker.Run(); }) {}

  ~Impl() {
    progress.Stop();
    worker.Cancel();
    client->Cancel();
    if (thread.joinable()) thread.join();
  }

  Status WaitForOptimization(steady_clock::time_point deadline);

  const std::unique_ptr<MapClient> client;
  const ClientSession session;
  const Camera camera;
  SessionProgress progress;
  NetworkWorker worker;
  std::unique_ptr<WatchHandle> watch;  // ends before what its events change
  std::thread thread;
};

StatusOr<std::unique_ptr<Participant>> Participant::Open(const MapClientOptions& client_options,
                                                         const ParticipantOptions& options, const Camera& camera,
                                                         SensorKind sensor, SlamAdapter* adapter) {
  MAPP_RETURN_IF_ERROR(options.Validate());
  MAPP_RETURN_IF_ERROR(camera.Validate());
  if (adapter == nullptr && options.policy != UploadPolicy::kUploadAll) {
    return absl::InvalidArgumentError("adapter: must be given, except with kUploadAll");
  }
  MAPP_ASSIGN_OR_RETURN(std::unique_ptr<MapClient> client, MapClient::Create(client_options));
  MAPP_ASSIGN_OR_RETURN(const ClientSession session,
                        client->OpenSession(options.map_name, options.device, sensor, camera, options.create_map));
  std::unique_ptr<Participant> participant(
      new Participant(std::make_unique<Impl>(std::move(client), options, session, camera, adapter)));
  MAPP_RETURN_IF_ERROR(participant->impl_->progress.WaitForWatch(steady_clock::now() + client_options.call_timeout));
  return participant;
}

Participant::Participant(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Participant::~Participant() = default;

void Participant::OnKeyframe(Keyframe keyframe) {
  keyframe.session = impl_->session.id;
  if (const Status status = Validate(keyframe, impl_->camera); !status.ok()) {
    impl_->progress.UpdateStats([&](ParticipantStats& stats) {
      ++stats.num_keyframes;
      ++stats.num_rejected;
      stats.last_error = status.ToString();
    });
    return;
  }
  const KeyframeTotals totals = KeyframeTotals::Of(keyframe);
  impl_->progress.UpdateStats([&](ParticipantStats& stats) { stats.full += totals; });
  impl_->progress.AddKeyframe(std::move(keyframe));
}

void Participant::OnSharedMapFrame(const SharedMapFrame& frame,
                                   const std::function<std::optional<Keyframe>()>& last_keyframe) {
  if (!impl_->progress.BeginFailure(frame)) return;
  std::optional<Keyframe> keyframe = last_keyframe();
  if (keyframe) keyframe->session = impl_->session.id;
  if (keyframe && !Validate(*keyframe, impl_->camera).ok()) keyframe.reset();
  impl_->progress.AddFailure(frame, std::move(keyframe));
}

ParticipantState Participant::state() const { return impl_->progress.state(); }
std::optional<Pose3> Participant::T_map_session() const { return impl_->progress.T_map_session(); }
SessionId Participant::session() const { return impl_->session.id; }

Status Participant::WaitIdle(std::chrono::milliseconds timeout) {
  return impl_->progress.Wait(steady_clock::now() + timeout, /*compared=*/true);
}

Status Participant::Close(std::chrono::milliseconds timeout, bool wait_for_optimization) {
  if (state() == ParticipantState::kClosed) return absl::OkStatus();
  const auto deadline = steady_clock::now() + timeout;
  impl_->progress.CloseIntake();
  MAPP_RETURN_IF_ERROR(impl_->progress.Wait(deadline, /*compared=*/false));
  const auto closed = impl_->client->CloseSession(impl_->session.id);
  MAPP_RETURN_IF_ERROR(closed.status());
  impl_->progress.SetClosed();
  const bool optimization_pending = closed->second;
  if (!wait_for_optimization || !optimization_pending) return absl::OkStatus();
  return impl_->WaitForOptimization(deadline);
}

Status Participant::Impl::WaitForOptimization(steady_clock::time_point deadline) {
  while (true) {
    switch (progress.WaitForOptimization(deadline)) {
      case SessionProgress::OptimizationWait::kEnded:
        return absl::OkStatus();
      case SessionProgress::OptimizationWait::kTimedOut:
        return absl::DeadlineExceededError("the optimisation after the session has not ended yet");
      case SessionProgress::OptimizationWait::kWatchRestarted: {
        // The server was away: closing once more tells whether the optimisation is still owed.
        const auto closed = client->CloseSession(session.id);
        MAPP_RETURN_IF_ERROR(closed.status());
        if (!closed->second) return absl::OkStatus();
      }
    }
  }
}

ParticipantStats Participant::stats() const {
  ParticipantStats stats = impl_->progress.stats();
  stats.traffic = impl_->client->traffic();
  return stats;
}

}  // namespace mapp
