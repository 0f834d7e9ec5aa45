#include "server/changes/thing_groups.h"

#include "server/changes/neighbor_grid.h"

#include <algorithm>
#include <limits>
#include <map>
#include <numeric>
#include <utility>

namespace mapp {
namespace {

/// Of the sessions that found one of two points of one thing there (and of those that found one gone) at least so many
/// say the same of the other.
constexpr double kMinAgreement = 0.7;

// Of SplitAtNecks: points that have so many neighbours within kDensityRadiusM as this share of the median are core
// points; core points further apart than kCoreGapM belong to different parts, which hold a share of all points each.
constexpr size_t kMinSplitPoints = 150;
constexpr float kDensityRadiusM = 0.25F;
constexpr double kCoreDensity = 0.1;
constexpr float kCoreGapM = 0.25F;
constexpr size_t kLeastPart = 50;

class Forest {
 public:
  explicit Forest(size_t size) : parents_(size) { std::iota(parents_.begin(), parents_.end(), size_t{0}); }
  size_t RootOf(size_t i) {
    while (parents_[i] != i) i = parents_[i] = parents_[parents_[i]];
    return i;
  }
  void Join(size_t a, size_t b) {
    const size_t root_a = RootOf(a), root_b = RootOf(b);
    parents_[std::max(root_a, root_b)] = std::min(root_a, root_b);
  }

 private:
  std::vector<size_t> parents_;
};

}  // namespace

bool TellTheSame(const PointCourse& a, const PointCourse& b) {
  size_t num_against = 0, num_there = 0, num_gone = 0;
  auto left = a.visits.begin(), right = b.visits.begin();
  while (left != a.visits.end() && right != b.visits.end()) {
    if (left->session != right->session) {
      ++(left->session < right->session ? left : right);
      continue;
    }
    num_against += left->is_there != right->is_there ? 1 : 0;
    num_there += left->is_there && right->is_there ? 1 : 0;
    num_gone += !left->is_there && !right->is_there ? 1 : 0;
    ++left, ++right;
  }
  const auto agree = [&](size_t num_alike) {
    return static_cast<double>(num_alike) >= kMinAgreement * static_cast<double>(num_alike + num_against);
  };
  return num_gone > 0 && agree(num_gone) && agree(num_there);
}

std::vector<std::vector<size_t>> SplitAtNecks(std::span<const Eigen::Vector3f> p_of_things_map,
                                              const Eigen::Vector3f& up_map) {
  std::vector<Eigen::Vector3f> p_map;
  for (const Eigen::Vector3f& p : p_of_things_map) p_map.push_back(p - up_map * up_map.dot(p));
  std::vector<size_t> everything(p_map.size());
  std::iota(everything.begin(), everything.end(), size_t{0});
  if (p_map.size() < kMinSplitPoints) return {everything};
  std::vector<size_t> num_near(p_map.size(), 0);
  const NeighborGrid near(p_map, kDensityRadiusM);
  for (size_t i = 0; i < p_map.size(); ++i) near.VisitWithin(p_map[i], [&](size_t, float) { ++num_near[i]; });
  std::vector<size_t> sorted = num_near;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  const auto least = static_cast<size_t>(kCoreDensity * static_cast<double>(*middle));
  const auto is_core = [&](size_t i) { return num_near[i] >= least; };

  const NeighborGrid links(p_map, kCoreGapM);
  Forest forest(p_map.size());
  for (size_t i = 0; i < p_map.size(); ++i) {
    if (!is_core(i)) continue;
    links.VisitWithin(p_map[i], [&](size_t k, float) {
      if (k > i && is_core(k)) forest.Join(i, k);
    });
  }
  std::map<size_t, std::vector<size_t>> cores;
  for (size_t i = 0; i < p_map.size(); ++i) {
    if (is_core(i)) cores[forest.RootOf(i)].push_back(i);
  }
  std::erase_if(cores, [&](const auto& part) { return part.second.size() < kLeastPart; });
  if (cores.size() < 2) return {everything};
  std::vector<std::vector<size_t>> parts;
  std::vector<size_t> part_of(p_map.size(), p_map.size());
  for (const auto& [root, members] : cores) {
    for (const size_t i : members) part_of[i] = parts.size();
    parts.emplace_back();
  }
  // The rest goes to whom it is nearest to.
  for (size_t i = 0; i < p_map.size(); ++i) {
    size_t nearest = part_of[i];
    float least_m2 = std::numeric_limits<float>::infinity();
    for (size_t k = 0; k < p_map.size() && part_of[i] == p_map.size(); ++k) {
      if (part_of[k] == p_map.size() || !is_core(k)) continue;
      const float squared_m2 = (p_map[i] - p_map[k]).squaredNorm();
      if (squared_m2 < least_m2) least_m2 = squared_m2, nearest = part_of[k];
    }
    parts[nearest].push_back(i);
  }
  return parts;
}

std::vector<ChangedThing> GroupThings(std::span<const PointCourse> courses, std::span<const Eigen::Vector3f> p_map,
                                      const Eigen::Vector3f& up_map, const GroupingOptions& options) {
  const NeighborGrid grid(p_map, options.gap_m);
  Forest forest(courses.size());
  for (size_t i = 0; i < courses.size(); ++i) {
    grid.VisitWithin(p_map[i], [&](size_t j, float) {
      if (j > i && forest.RootOf(i) != forest.RootOf(j) && TellTheSame(courses[i], courses[j])) forest.Join(i, j);
    });
  }
  std::map<size_t, ChangedThing> by_root;
  for (size_t i = 0; i < courses.size(); ++i) by_root[forest.RootOf(i)].points.push_back(i);
  std::vector<ChangedThing> things;
  for (const auto& [root, thing] : by_root) {
    std::vector<Eigen::Vector3f> positions;
    for (const size_t i : thing.points) positions.push_back(p_map[i]);
    for (const std::vector<size_t>& part : SplitAtNecks(positions, up_map)) {
      if (part.size() < options.min_points) continue;
      ChangedThing& one = things.emplace_back();
      one.group = root;
      for (const size_t k : part) one.points.push_back(thing.points[k]);
    }
  }
  return things;
}

}  // namespace mapp
