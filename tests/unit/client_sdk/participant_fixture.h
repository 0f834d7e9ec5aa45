#pragma once

#include "fake_map_service.h"
#include "mapp/client/participant.h"
#include "synthetic_views.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <optional>
#include <vector>

namespace mapp {

inline constexpr std::chrono::milliseconds kPatience{10'000};
inline constexpr std::chrono::milliseconds kShortWait{100};

/// Records what a SLAM system would have been given. Thread-safe.
class RecordingAdapter final : public SlamAdapter {
 public:
  void TakeSharedMap(std::shared_ptr<const SharedMap> map) override {
    MutexLock lock(mutex_);
    maps_.push_back(std::move(map));
  }
  void LeaveSharedMap() override {
    MutexLock lock(mutex_);
    ++num_left_;
  }
  std::vector<std::shared_ptr<const SharedMap>> maps() const {
    MutexLock lock(mutex_);
    return maps_;
  }
  int num_left() const {
    MutexLock lock(mutex_);
    return num_left_;
  }

 private:
  mutable Mutex mutex_;
  std::vector<std::shared_ptr<const SharedMap>> maps_ ABSL_GUARDED_BY(mutex_);
  int num_left_ ABSL_GUARDED_BY(mutex_) = 0;
};

/// Camera of the session's first orientation, `x` metres to the right of its start.
inline Pose3 At(double x) { return Pose3(Eigen::Quaterniond::Identity(), {x, 0, 0}); }

class ParticipantTest : public ::testing::Test {
 protected:
  ParticipantTest() {
    options_.map_name = "place";
    client_options_.server_address = server_.address();
    client_options_.first_backoff = std::chrono::milliseconds(1);
    client_options_.max_backoff = std::chrono::milliseconds(5);
    client_options_.retry_for = std::chrono::milliseconds(200);
  }

  void Open(SensorKind sensor = SensorKind::kRgbd) {
    auto opened = Participant::Open(client_options_, options_, TestCamera(), sensor, &adapter_);
    ASSERT_TRUE(opened.ok()) << opened.status();
    participant_ = *std::move(opened);
  }
  /// As founder: aligned by its first upload, which is keyframe 0.
  void OpenAligned() {
    server_.Change([](FakeMapService::Script& script) { script.T_map_session = TestAlignment(); });
    Open();
    HandIn(0);
  }
  /// Aligned, and on shared map number 1.
  void OpenSharing() {
    OpenAligned();
    server_.Change([](FakeMapService::Script& script) {
      script.samples_redundant = true;
      script.tiles = {TestTile(Revision(1))};
    });
    HandIn(1);
    ASSERT_EQ(participant_->state(), ParticipantState::kSharing);
  }
  void HandIn(uint32_t number) {
    participant_->OnKeyframe(TestKeyframe(number, At(0.1 * number)));
    const Status idle = participant_->WaitIdle(kPatience);
    ASSERT_TRUE(idle.ok()) << idle;
  }
  /// A frame on shared map `number`; a failed one brings a keyframe numbered 100.
  void Frame(uint32_t number, bool localized) {
    const SharedMapFrame frame{.shared_map_number = number,
                               .num_matches = localized ? 200 : 3,
                               .localized = localized,
                               .T_session_camera = {}};
    participant_->OnSharedMapFrame(frame, [this] {
      ++num_keyframes_asked_;
      return std::optional(TestKeyframe(100, At(0.2)));
    });
    const Status idle = participant_->WaitIdle(kPatience);
    ASSERT_TRUE(idle.ok()) << idle;
  }

  FakeMapService server_;
  RecordingAdapter adapter_;
  MapClientOptions client_options_;
  ParticipantOptions options_;
  int num_keyframes_asked_ = 0;
  std::unique_ptr<Participant> participant_;  // last: uses all of the above
};

}  // namespace mapp
