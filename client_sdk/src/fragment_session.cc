#include "fragment_session.h"

#include <utility>

namespace mapp {

void FragmentAdapter::TakeSharedMap(std::shared_ptr<const SharedMap> map) {
  MutexLock lock(mutex_);
  if (system_ != nullptr) system_->TakeSharedMap(std::move(map));
}

void FragmentAdapter::LeaveSharedMap() {
  MutexLock lock(mutex_);
  if (system_ != nullptr) system_->LeaveSharedMap();
}

void FragmentAdapter::Silence() {
  MutexLock lock(mutex_);
  system_ = nullptr;
}

FragmentSession::FragmentSession(std::unique_ptr<MapClient> client, const SessionSetup& setup, SlamAdapter* adapter,
                                 size_t min_to_open)
    : client_(std::move(client)),
      camera_(setup.camera),
      features_(setup.participation.features),
      report_evidence_(setup.participation.report_evidence),
      adapter_(adapter),
      progress_(setup.participation.max_queued_keyframes, min_to_open),
      worker_(*client_, progress_, &adapter_, setup) {}

FragmentSession::~FragmentSession() { Stop(); }

Status FragmentSession::Open() {
  MAPP_RETURN_IF_ERROR(worker_.Open());
  OpenInBackground();
  return absl::OkStatus();
}

void FragmentSession::OpenInBackground() {
  thread_ = std::thread([this] { worker_.Run(); });
}

void FragmentSession::Stop() {
  progress_.Stop();
  worker_.Cancel();
  client_->Cancel();
  if (thread_.joinable()) thread_.join();
}

void FragmentSession::OnKeyframe(Keyframe keyframe) {
  if (const Status status = Validate(keyframe, camera_, features_); !status.ok()) {
    progress_.UpdateStats([&](ParticipantStats& stats) {
      ++stats.num_keyframes;
      ++stats.num_rejected;
      stats.last_error = status.ToString();
    });
    return;
  }
  const KeyframeTotals totals = KeyframeTotals::Of(keyframe);
  progress_.UpdateStats([&](ParticipantStats& stats) { stats.full += totals; });
  progress_.AddKeyframe(std::move(keyframe));
}

void FragmentSession::OnSharedMapFrame(const SharedMapFrame& frame,
                                       const std::function<std::optional<Keyframe>()>& last_keyframe) {
  if (!progress_.BeginFailure(frame)) {
    if (report_evidence_ && progress_.WantsView(frame)) AddView(frame, last_keyframe());
    return;
  }
  std::optional<Keyframe> keyframe = last_keyframe();
  if (keyframe && !Validate(*keyframe, camera_, features_).ok()) keyframe.reset();
  progress_.AddFailure(frame, std::move(keyframe));
}

void FragmentSession::AddView(const SharedMapFrame& frame, std::optional<Keyframe> keyframe) {
  if (!keyframe) return;
  if (!keyframe->raster) keyframe->raster = RasterOf(*keyframe, camera_);
  if (Validate(*keyframe, camera_, features_).ok()) progress_.AddView(*std::move(keyframe), frame.shared_map_number);
}

void FragmentSession::EndFragment() {
  adapter_.Silence();
  BeginClose();
}

Status FragmentSession::Close(std::chrono::steady_clock::time_point deadline, bool wait_for_optimization) {
  BeginClose();
  MAPP_RETURN_IF_ERROR(progress_.WaitClosed(deadline));
  return wait_for_optimization ? WaitForOptimization(deadline) : absl::OkStatus();
}

Status FragmentSession::WaitEnded(std::chrono::steady_clock::time_point deadline) {
  const Status closed = progress_.WaitClosed(deadline);
  if (closed.ok()) return WaitForOptimization(deadline);
  // What the server has refused for good is not waited for.
  return state() == ParticipantState::kClosed ? absl::OkStatus() : closed;
}

Status FragmentSession::WaitForOptimization(std::chrono::steady_clock::time_point deadline) {
  while (true) {
    switch (progress_.WaitForOptimization(deadline)) {
      case SessionProgress::OptimizationWait::kEnded:
        return absl::OkStatus();
      case SessionProgress::OptimizationWait::kTimedOut:
        return absl::DeadlineExceededError("the optimisation after the session has not ended yet");
      case SessionProgress::OptimizationWait::kWatchRestarted: {
        // The server was away: closing once more tells whether the optimisation is still owed.
        const auto closed = client_->CloseSession(*session());
        MAPP_RETURN_IF_ERROR(closed.status());
        progress_.OnClosed(/*optimization_pending=*/closed->second);
      }
    }
  }
}

StatusOr<std::vector<ClientKeyframePose>> FragmentSession::FetchKeyframePoses() {
  if (!T_map_session()) return std::vector<ClientKeyframePose>();
  return client_->GetSessionPoses(*session());
}

SessionFigures FragmentSession::figures() const {
  SessionFigures figures = progress_.figures();
  figures.counts.traffic = client_->traffic();
  return figures;
}

ParticipantFragment FragmentSession::Describe() const {
  ParticipantFragment fragment{
      .session = session(), .state = state(), .T_map_session = {}, .stats = figures().Summary()};
  if (const std::optional<Sim3> S_map_session = progress_.S_map_session()) {
    fragment.T_map_session = S_map_session->pose;
    fragment.scale_map_session = S_map_session->scale;
  }
  return fragment;
}

}  // namespace mapp
