#pragma once

#include <Eigen/Core>

#include <deque>

namespace mapp {

/// The last metres of a camera's way: where it is going. Not thread-safe.
class RecentWay {
 public:
  void Add(const Eigen::Vector3d& p_session) {
    if (!points_.empty() && (p_session - points_.back()).norm() < kStepM) return;
    points_.push_back(p_session);
    while ((points_[0] - p_session).norm() > kLengthM) points_.pop_front();
  }
  /// How it moved over them, metres, frame `session`; zero where it has gone too little to tell.
  Eigen::Vector3d Motion() const {
    if (points_.empty()) return Eigen::Vector3d::Zero();
    const Eigen::Vector3d motion = points_.back() - points_.front();
    return motion.norm() < kMinMotionM ? Eigen::Vector3d::Zero() : motion;
  }

 private:
  static constexpr double kStepM = 0.1;
  static constexpr double kLengthM = 2.0;
  static constexpr double kMinMotionM = 0.3;
  std::deque<Eigen::Vector3d> points_;
};

}  // namespace mapp
