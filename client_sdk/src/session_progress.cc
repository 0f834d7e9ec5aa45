#include "session_progress.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace mapp {
namespace {

/// Frames on shared maps are judged this far from each other: their views overlap by far the most, and say the same.
constexpr double kViewStepM = 1.0;
constexpr double kViewStepRad = 0.6;
constexpr size_t kMaxViews = 8;
constexpr const char* kNotAcknowledged = "the server has not acknowledged the end of the session yet";

}  // namespace

void SessionProgress::AddKeyframe(Keyframe keyframe) {
  MutexLock lock(mutex_);
  recent_way_.Add(keyframe.T_frame_camera.translation());
  ParticipantStats& stats = figures_.counts;
  ++stats.num_keyframes;
  if (!outcome_.ok()) {
    ++stats.num_rejected;
    return;
  }
  if (closing_) {
    ++stats.num_dropped;
    return;
  }
  keyframe.number += num_evidence_;
  next_number_ = std::max(next_number_, keyframe.number + 1);
  if (queue_.size() >= max_queued_) {
    queue_.pop_front();
    ++stats.num_dropped;
  }
  queue_.push_back({.keyframe = std::move(keyframe), .localized_on_map = localized_on_map_, .is_evidence = false});
  changed_.NotifyAll();
}

bool SessionProgress::BeginFailure(const SharedMapFrame& frame) {
  MutexLock lock(mutex_);
  if (closing_ || state_ != ParticipantState::kSharing || frame.shared_map_number != shared_map_number_) return false;
  if (frame.localized) {
    recent_way_.Add(frame.T_session_camera.translation());
    num_maps_tried_ = 0;
    localized_on_map_ = true;
    return false;
  }
  if (failure_in_hand_) return false;
  failure_in_hand_ = true;
  if (num_maps_tried_ == 0) ++figures_.counts.num_sharing_failures;
  return true;
}

void SessionProgress::AddFailure(const SharedMapFrame& frame, std::optional<Keyframe> keyframe) {
  MutexLock lock(mutex_);
  failure_ = FailureJob{.frame = frame, .keyframe = std::move(keyframe), .num_maps_tried = num_maps_tried_};
  changed_.NotifyAll();
}

bool SessionProgress::WantsView(const SharedMapFrame& frame) {
  MutexLock lock(mutex_);
  if (closing_ || state_ != ParticipantState::kSharing || frame.shared_map_number != shared_map_number_) return false;
  if (!frame.localized) return false;
  if (T_session_camera_viewed_ && Distance(*T_session_camera_viewed_, frame.T_session_camera) < kViewStepM &&
      RotationAngle(*T_session_camera_viewed_, frame.T_session_camera) < kViewStepRad) {
    return false;
  }
  T_session_camera_viewed_ = frame.T_session_camera;
  return true;
}

void SessionProgress::AddView(Keyframe keyframe, uint32_t shared_map_number) {
  MutexLock lock(mutex_);
  if (closing_ || views_.size() >= kMaxViews) return;
  views_.push_back({std::move(keyframe), shared_map_number});
  changed_.NotifyAll();
}

void SessionProgress::BeginClose() {
  MutexLock lock(mutex_);
  closing_ = true;
  just_aligned_ = false;  // no map is needed any more
  changed_.NotifyAll();
}

std::string SessionProgress::Missing() const {
  if (!session_ && !closing_ && queue_.size() < min_to_open_) return "";
  if (close_in_hand_) return kNotAcknowledged;
  if (!queue_.empty() || busy_) return fmt::format("{} keyframes are not sent yet", queue_.size() + (busy_ ? 1 : 0));
  if (just_aligned_) return "the map around the aligned keyframe is not asked for yet";
  if (failure_in_hand_) return "a failure on the shared map is not resolved yet";
  if (!views_.empty()) return "what was seen of the shared map is not summed up yet";
  if (S_map_session_ || !last_unaligned_upload_) return "";
  if (last_compared_ && *last_compared_ >= *last_unaligned_upload_) return "";
  return fmt::format("the server has not compared keyframe {} with the map yet", *last_unaligned_upload_);
}

Status SessionProgress::WaitIdle(std::chrono::steady_clock::time_point deadline) {
  MutexLock lock(mutex_);
  while (true) {
    if (stopped_) return absl::CancelledError("the participant was shut down");
    const std::string missing = Missing();
    if (missing.empty()) return absl::OkStatus();
    if (!changed_.WaitUntil(mutex_, deadline) && std::chrono::steady_clock::now() >= deadline) {
      const std::string still_missing = Missing();
      return still_missing.empty() ? absl::OkStatus() : absl::DeadlineExceededError(still_missing);
    }
  }
}

Status SessionProgress::WaitClosed(std::chrono::steady_clock::time_point deadline) {
  MutexLock lock(mutex_);
  const int num_failures_before = num_close_failures_;
  bool in_time = true;
  while (true) {
    if (state_ == ParticipantState::kClosed) return outcome_;
    if (stopped_) return absl::CancelledError("the participant was shut down");
    if (num_close_failures_ > num_failures_before) return close_failure_;
    if (!in_time) {
      const bool all_sent = queue_.empty() && views_.empty() && !failure_in_hand_ && (!busy_ || close_in_hand_);
      if (!all_sent) return absl::DeadlineExceededError(Missing());
      const std::string why = close_failure_.ok() ? "" : ": " + close_failure_.ToString();
      return absl::DeadlineExceededError(kNotAcknowledged + why);
    }
    in_time = changed_.WaitUntil(mutex_, deadline) || std::chrono::steady_clock::now() < deadline;
  }
}

Status SessionProgress::WaitForWatch(std::chrono::steady_clock::time_point deadline) {
  MutexLock lock(mutex_);
  while (num_watch_starts_ == 0) {
    if (stopped_) return absl::CancelledError("the participant was shut down");
    if (!changed_.WaitUntil(mutex_, deadline) && std::chrono::steady_clock::now() >= deadline) {
      return absl::DeadlineExceededError("the server did not begin to tell of the session's events");
    }
  }
  num_watch_starts_seen_ = num_watch_starts_;
  return absl::OkStatus();
}

bool SessionProgress::WaitUntilWorthOpening() {
  MutexLock lock(mutex_);
  while (!stopped_ && !closing_ && queue_.size() < min_to_open_) changed_.Wait(mutex_);
  if (stopped_) return false;
  if (!queue_.empty() && queue_.size() >= min_to_open_) return true;
  figures_.counts.num_skipped += queue_.size();
  queue_.clear();
  End(absl::OkStatus());
  return false;
}

void SessionProgress::OnOpened(SessionId session) {
  MutexLock lock(mutex_);
  session_ = session;
}

void SessionProgress::OnOpeningRefused(const Status& why) {
  MutexLock lock(mutex_);
  figures_.counts.num_rejected += queue_.size();
  queue_.clear();
  End(why);
}

void SessionProgress::End(const Status& outcome) {
  outcome_ = outcome;
  state_ = ParticipantState::kClosed;
  close_in_hand_ = false;
  changed_.NotifyAll();
}

std::optional<Job> SessionProgress::NextJob() {
  MutexLock lock(mutex_);
  const auto may_close = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return closing_ && !failure_in_hand_; };
  while (!stopped_ && !failure_ && queue_.empty() && !just_aligned_ && views_.empty() && !may_close()) {
    changed_.Wait(mutex_);
  }
  if (stopped_ || state_ == ParticipantState::kClosed) return std::nullopt;
  busy_ = true;
  if (failure_) return *std::exchange(failure_, std::nullopt);
  // A keyframe that waits is newer than the uploaded one, and asks by itself.
  if (std::exchange(just_aligned_, false) && queue_.empty()) return AlignedJob{};
  if (queue_.empty() && !views_.empty()) {
    ViewJob job = std::move(views_.front());
    views_.pop_front();
    return job;
  }
  if (queue_.empty()) {
    close_in_hand_ = true;
    return CloseJob{};
  }
  KeyframeJob job = std::move(queue_.front());
  queue_.pop_front();
  return job;
}

void SessionProgress::JobDone() {
  MutexLock lock(mutex_);
  busy_ = false;
  changed_.NotifyAll();
}

void SessionProgress::AddEvidence(Keyframe keyframe, bool localized_on_map) {
  MutexLock lock(mutex_);
  keyframe.number = next_number_++;
  ++num_evidence_;
  queue_.push_front({.keyframe = std::move(keyframe), .localized_on_map = localized_on_map, .is_evidence = true});
}

void SessionProgress::OnUploaded(uint32_t number, const ClientUpload& upload) {
  MutexLock lock(mutex_);
  ++figures_.counts.num_uploaded;
  if (upload.T_map_session) {
    Align({upload.scale_map_session, *upload.T_map_session}, number);
  } else if (!upload.already_stored) {
    // What was stored before a restart may have been compared before it, too: nobody would tell us again.
    last_unaligned_upload_ = number;
    if (S_map_session_) just_aligned_ = !closing_;  // the event has overtaken the upload's answer
  }
  changed_.NotifyAll();
}

void SessionProgress::Align(const Sim3& S_map_session, uint32_t keyframe) {
  S_map_session_ = S_map_session;
  std::optional<uint32_t>& aligned_at = figures_.counts.aligned_at_keyframe;
  if (!aligned_at) aligned_at = keyframe;
  if (state_ != ParticipantState::kRegistering) return;
  state_ = ParticipantState::kExpanding;
  just_aligned_ = last_unaligned_upload_.has_value() && !closing_;
}

void SessionProgress::OnSharedMap(uint32_t number) {
  MutexLock lock(mutex_);
  if (state_ == ParticipantState::kSharing) {
    ++num_maps_tried_;  // a further map after a failure
  } else {
    num_maps_tried_ = 0;
  }
  state_ = ParticipantState::kSharing;
  shared_map_number_ = number;
  failure_in_hand_ = false;
  changed_.NotifyAll();
}

void SessionProgress::OnSharedMapWhole(uint32_t number) {
  MutexLock lock(mutex_);
  shared_map_number_ = number;
  failure_in_hand_ = false;
  failure_.reset();
  changed_.NotifyAll();
}

void SessionProgress::OnLeftSharedMap() {
  MutexLock lock(mutex_);
  state_ = ParticipantState::kExpanding;
  failure_in_hand_ = false;
  changed_.NotifyAll();
}

std::map<TileKey, Revision> SessionProgress::TakeChangedTiles() {
  MutexLock lock(mutex_);
  return std::exchange(changed_tiles_, {});
}

Eigen::Vector3d SessionProgress::motion_session() const {
  MutexLock lock(mutex_);
  return recent_way_.Motion();
}

void SessionProgress::UpdateStats(const std::function<void(ParticipantStats&)>& change) {
  MutexLock lock(mutex_);
  change(figures_.counts);
}

void SessionProgress::RecordLatency(Step step, std::chrono::nanoseconds duration) {
  MutexLock lock(mutex_);
  figures_.Of(step).Add(duration);
}

struct SessionProgress::EventVisitor {
  SessionProgress& progress;

  void operator()(const AlignmentTriedEvent& event) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(progress.mutex_) {
    progress.last_compared_ = std::max(progress.last_compared_.value_or(0), event.keyframe);
  }
  void operator()(const AlignedEvent& event) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(progress.mutex_) {
    progress.figures_.counts.aligned_at_keyframe = event.keyframe;
    progress.Align({event.scale_map_session, event.T_map_session}, event.keyframe);
  }
  void operator()(const CorrectedEvent& event) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(progress.mutex_) {
    progress.S_map_session_ = Sim3{event.scale_map_session, event.T_map_session};
  }
  void operator()(const TilesChangedEvent& event) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(progress.mutex_) {
    for (const TileKey& key : event.keys) {
      Revision& revision = progress.changed_tiles_[key];
      revision = std::max(revision, event.revision);
    }
  }
  void operator()(const OptimizedEvent&) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(progress.mutex_) {
    progress.optimized_ = true;
  }
  void operator()(const QuarantinedEvent& event) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(progress.mutex_) {
    progress.figures_.counts.quarantine_reason = event.reason;
  }
  void operator()(const ReleasedEvent&) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(progress.mutex_) {
    progress.figures_.counts.quarantine_reason.reset();
  }
  void operator()(const WatchStartedEvent&) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(progress.mutex_) {
    // Comparisons may have ended unheard while the stream was down: wait for none of before.
    if (progress.num_watch_starts_++ > 0) progress.last_compared_ = progress.last_unaligned_upload_;
  }
};

void SessionProgress::OnEvent(const ClientEvent& event) {
  MutexLock lock(mutex_);
  std::visit(EventVisitor{*this}, event);
  changed_.NotifyAll();
}

SessionProgress::OptimizationWait SessionProgress::WaitForOptimization(std::chrono::steady_clock::time_point deadline) {
  MutexLock lock(mutex_);
  while (optimization_pending_ && !optimized_ && num_watch_starts_ == num_watch_starts_seen_) {
    if (!changed_.WaitUntil(mutex_, deadline) && std::chrono::steady_clock::now() >= deadline) {
      return OptimizationWait::kTimedOut;
    }
  }
  num_watch_starts_seen_ = num_watch_starts_;
  return optimized_ || !optimization_pending_ ? OptimizationWait::kEnded : OptimizationWait::kWatchRestarted;
}

void SessionProgress::OnCloseFailed(const Status& why) {
  MutexLock lock(mutex_);
  ++num_close_failures_;
  close_failure_ = why;
  changed_.NotifyAll();
}

void SessionProgress::OnClosed(bool optimization_pending) {
  MutexLock lock(mutex_);
  optimization_pending_ = optimization_pending;
  End(absl::OkStatus());
}

void SessionProgress::OnCloseRefused(const Status& why) {
  MutexLock lock(mutex_);
  End(why);
}

void SessionProgress::Stop() {
  MutexLock lock(mutex_);
  figures_.counts.num_dropped += queue_.size();
  queue_.clear();
  stopped_ = true;
  changed_.NotifyAll();
}

ParticipantState SessionProgress::state() const {
  MutexLock lock(mutex_);
  return state_;
}

std::optional<Pose3> SessionProgress::T_map_session() const {
  const std::optional<Sim3> S_map_session = this->S_map_session();
  if (!S_map_session) return std::nullopt;
  return S_map_session->pose;
}

std::optional<Sim3> SessionProgress::S_map_session() const {
  MutexLock lock(mutex_);
  return S_map_session_;
}

bool SessionProgress::closing() const {
  MutexLock lock(mutex_);
  return closing_;
}

std::optional<SessionId> SessionProgress::session() const {
  MutexLock lock(mutex_);
  return session_;
}

SessionFigures SessionProgress::figures() const {
  MutexLock lock(mutex_);
  return figures_;
}

}  // namespace mapp
