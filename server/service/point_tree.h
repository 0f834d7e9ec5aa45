#pragma once

#include "mapp/base/status.h"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <memory>
#include <vector>

namespace mapp {

/// KD-tree over a fixed set of points (FLANN). Thread-safe once built.
class PointTree {
 public:
  /// INVALID_ARGUMENT without points; INTERNAL when FLANN refuses.
  static StatusOr<PointTree> Build(const std::vector<Eigen::Vector3f>& points);
  PointTree(PointTree&&) noexcept;
  PointTree& operator=(PointTree&&) noexcept;
  ~PointTree();

  /// Whether `accept(index)` holds for any point nearer to `p` than `radius`. Stops at the first one that it accepts:
  /// most searches that succeed end in the first leaf. Points come in no particular order.
  template <typename Accept>
  bool AnyWithin(const Eigen::Vector3f& p, float radius, const Accept& accept) const {
    return Search(
        p, radius, [](const void* context, size_t index) { return (*static_cast<const Accept*>(context))(index); },
        &accept);
  }

  /// Indices of the (at most) `count` points nearest to `p`, nearest first.
  std::vector<size_t> Nearest(const Eigen::Vector3f& p, size_t count) const;

  const std::vector<Eigen::Vector3f>& points() const;
  /// Memory it holds, approximately.
  size_t bytes() const;

 private:
  struct Impl;
  using AcceptFunction = bool (*)(const void* context, size_t index);
  explicit PointTree(std::unique_ptr<Impl> impl);
  bool Search(const Eigen::Vector3f& p, float radius, AcceptFunction accept, const void* context) const;

  std::unique_ptr<Impl> impl_;
  Eigen::AlignedBox3f bounds_;
};

}  // namespace mapp
