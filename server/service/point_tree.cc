#include "server/service/point_tree.h"

#include <flann/flann.hpp>
#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace mapp {
namespace {

using FlannDistance = flann::L2_Simple<float>;
using Index = flann::KDTreeSingleIndex<FlannDistance>;

constexpr int kLeafSize = 10;  // FLANN's own default

/// Hands every point within the radius to `accept` until one is taken; from then on nothing is near enough, so that
/// FLANN prunes the rest of the tree.
class FirstAccepted final : public flann::ResultSet<float> {
 public:
  FirstAccepted(float squared_radius, bool (*accept)(const void*, size_t), const void* context)
      : worst_(squared_radius), accept_(accept), context_(context) {}

  bool full() const override { return found_; }
  void addPoint(float /*squared_distance*/, size_t index) override {
    if (found_ || !accept_(context_, index)) return;
    found_ = true;
    worst_ = -1;
  }
  float worstDist() const override { return worst_; }
  bool found() const { return found_; }

 private:
  float worst_;
  bool (*accept_)(const void*, size_t);
  const void* context_;
  bool found_ = false;
};

}  // namespace

struct PointTree::Impl {
  std::vector<Eigen::Vector3f> points;  // FLANN refers to them
  std::unique_ptr<Index> index;
};

PointTree::PointTree(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {
  for (const Eigen::Vector3f& point : impl_->points) bounds_.extend(point);
}
PointTree::PointTree(PointTree&&) noexcept = default;
PointTree& PointTree::operator=(PointTree&&) noexcept = default;
PointTree::~PointTree() = default;

StatusOr<PointTree> PointTree::Build(const std::vector<Eigen::Vector3f>& points) {
  if (points.empty()) return absl::InvalidArgumentError("building a KD-tree: there are no points");
  auto impl = std::make_unique<Impl>();
  impl->points = points;
  static_assert(sizeof(Eigen::Vector3f) == 3 * sizeof(float), "points must lie densely in memory");
  try {
    const flann::Matrix<float> matrix(impl->points.front().data(), impl->points.size(), 3);
    impl->index = std::make_unique<Index>(matrix, flann::KDTreeSingleIndexParams(kLeafSize));
    impl->index->buildIndex();
  } catch (const flann::FLANNException& error) {
    return absl::InternalError(fmt::format("building a KD-tree of {} points: {}", points.size(), error.what()));
  }
  return PointTree(std::move(impl));
}

bool PointTree::Search(const Eigen::Vector3f& p, float radius, AcceptFunction accept, const void* context) const {
  if (bounds_.squaredExteriorDistance(p) >= radius * radius) return false;
  FirstAccepted result(radius * radius, accept, context);
  impl_->index->findNeighbors(result, p.data(), flann::SearchParams());
  return result.found();
}

std::vector<size_t> PointTree::Nearest(const Eigen::Vector3f& p, size_t count) const {
  flann::KNNSimpleResultSet<float> result(std::min(count, impl_->points.size()));
  impl_->index->findNeighbors(result, p.data(), flann::SearchParams());
  std::vector<size_t> indices(result.size());
  std::vector<float> squared_distances(result.size());
  result.copy(indices.data(), squared_distances.data(), result.size());
  return indices;
}

const std::vector<Eigen::Vector3f>& PointTree::points() const { return impl_->points; }

size_t PointTree::bytes() const {
  // Twice the coordinates (FLANN keeps a reordered copy), an index and, per leaf, about two nodes of 64 bytes.
  const size_t num_points = impl_->points.size();
  return num_points * (2 * sizeof(Eigen::Vector3f) + sizeof(int)) + num_points / kLeafSize * 2 * 64;
}

}  // namespace mapp
