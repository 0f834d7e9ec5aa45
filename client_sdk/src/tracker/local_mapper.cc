#include "client_sdk/src/tracker/local_mapper.h"

#include "client_sdk/src/tracker/keyframe_export.h"
#include "client_sdk/src/tracker/local_bundle.h"
#include "client_sdk/src/tracker/point_fusion.h"
#include "client_sdk/src/tracker/triangulation.h"
#include "mapp/base/process_usage.h"

#include <utility>

namespace mapp::tracker {
namespace {

constexpr size_t kFusionNeighbors = 8;
/// Jobs waiting beyond which an adjustment is cut short: the next one goes on from where it stopped.
constexpr size_t kMaxWaitingDuringAdjustment = 2;
/// A new point must be found in a quarter of the frames that should show it, and be observed by a second keyframe once
/// two have passed (Mur-Artal et al. 2015, section VI-B).
constexpr double kMinFoundRatio = 0.25;
/// Without depth a point is made from two keyframes already, and needs a third, as there.
constexpr size_t kMinObservers = 2;
constexpr size_t kMinObserversMono = 3;
constexpr int kProbationKeyframes = 3;
constexpr int kMinVisibleForVerdict = 8;

}  // namespace

LocalMapper::LocalMapper(SharedSessionMap& shared, const TrackingCamera& camera, const OrbTrackerOptions& options)
    : shared_(shared), camera_(camera), options_(options) {
  if (!options_.synchronous) thread_ = std::thread([this] { Run(); });
}

LocalMapper::~LocalMapper() {
  {
    MutexLock lock(mutex_);
    stopping_ = true;
  }
  changed_.NotifyAll();
  if (thread_.joinable()) thread_.join();
}

void LocalMapper::ProcessKeyframe(int keyframe_idx) { Submit({Job::Kind::kProcessKeyframe, keyframe_idx}); }

void LocalMapper::RetireGeneration(int generation) { Submit({Job::Kind::kRetireGeneration, generation}); }

void LocalMapper::Submit(Job job) {
  if (options_.synchronous) {
    Execute(job);
    return;
  }
  {
    MutexLock lock(mutex_);
    waiting_.push_back(job);
  }
  changed_.NotifyAll();
}

void LocalMapper::Run() {
  while (true) {
    Job job;
    {
      MutexLock lock(mutex_);
      busy_ = false;
      changed_.NotifyAll();
      while (waiting_.empty() && !stopping_) changed_.Wait(mutex_);
      if (stopping_) return;
      job = waiting_.front();
      waiting_.pop_front();
      busy_ = true;
    }
    Execute(job);
  }
}

void LocalMapper::Execute(const Job& job) {
  const Stopwatch stopwatch;
  const double cpu_before_s = ThreadCpuSeconds();
  switch (job.kind) {
    case Job::Kind::kProcessKeyframe:
      Process(job.argument);
      break;
    case Job::Kind::kRetireGeneration: {
      recent_points_.clear();
      MutexLock lock(shared_.mutex);
      shared_.map.RetireGeneration(job.argument);
      break;
    }
  }
  const std::chrono::nanoseconds elapsed = stopwatch.Elapsed();
  const double cpu_s = ThreadCpuSeconds() - cpu_before_s;
  MutexLock lock(mutex_);
  cpu_s_ += cpu_s;
  if (job.kind == Job::Kind::kProcessKeyframe) latency_.Add(elapsed);
}

void LocalMapper::Process(int keyframe_idx) {
  CullRecentPoints(keyframe_idx);
  std::vector<int> neighbors;
  {
    MutexLock lock(shared_.mutex);
    neighbors = FusionNeighbors(shared_.map, camera_, keyframe_idx, kFusionNeighbors);
  }
  const std::vector<int> made = TriangulateWithNeighbors(shared_, camera_, keyframe_idx, neighbors);
  recent_points_.insert(recent_points_.end(), made.begin(), made.end());
  FuseWithNeighbors(shared_, camera_, keyframe_idx, neighbors);

  LocalBundleOptions bundle;
  bundle.window = options_.local_window;
  if (!options_.synchronous) {
    bundle.is_cancelled = [this] {
      MutexLock lock(mutex_);
      return stopping_ || waiting_.size() > kMaxWaitingDuringAdjustment;
    };
  }
  // A failed adjustment leaves the map as it was: the keyframe then goes out as it was tracked.
  AdjustLocalWindow(shared_, camera_, keyframe_idx, bundle).IgnoreError();

  Keyframe finished;
  {
    MutexLock lock(shared_.mutex);
    finished = ExportKeyframe(shared_.map, camera_, keyframe_idx);
  }
  MutexLock lock(mutex_);
  finished.number = next_number_++;
  finished_.push_back(std::move(finished));
}

void LocalMapper::CullRecentPoints(int keyframe_idx) {
  MutexLock lock(shared_.mutex);
  SessionMap& map = shared_.map;
  const size_t min_observers = camera_.metric() ? kMinObservers : kMinObserversMono;
  std::vector<int> still_recent;
  for (const int point_idx : recent_points_) {
    const MapPoint& point = map.point(point_idx);
    if (point.removed) continue;
    const int age = keyframe_idx - point.first_keyframe_idx;
    const bool rarely_found = point.num_visible >= kMinVisibleForVerdict &&
                              point.num_found < kMinFoundRatio * static_cast<double>(point.num_visible);
    const bool rarely_observed = age >= 2 && point.observations.size() < min_observers;
    if (rarely_found || rarely_observed) {
      map.RemovePoint(point_idx);
    } else if (age < kProbationKeyframes) {
      still_recent.push_back(point_idx);
    }
  }
  for (const int point_idx : map.keyframe(keyframe_idx).points) {
    if (point_idx != kNone && map.point(point_idx).first_keyframe_idx == keyframe_idx) {
      still_recent.push_back(point_idx);
    }
  }
  recent_points_ = std::move(still_recent);
}

std::vector<Keyframe> LocalMapper::TakeFinished() {
  MutexLock lock(mutex_);
  return std::exchange(finished_, {});
}

void LocalMapper::WaitIdle() {
  MutexLock lock(mutex_);
  while (busy_ || !waiting_.empty()) changed_.Wait(mutex_);
}

size_t LocalMapper::num_waiting() const {
  MutexLock lock(mutex_);
  return waiting_.size();
}

bool LocalMapper::idle() const {
  MutexLock lock(mutex_);
  return waiting_.empty() && !busy_;
}

double LocalMapper::cpu_s() const {
  MutexLock lock(mutex_);
  return cpu_s_;
}

LatencyRecorder LocalMapper::latency() const {
  MutexLock lock(mutex_);
  return latency_;
}

}  // namespace mapp::tracker
