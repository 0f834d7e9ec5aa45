#include "vision/corner_spreading.h"

#include <algorithm>
#include <array>
#include <queue>

namespace mapp::internal {
namespace {

/// A square of the image and the corners in it, as a range of the permuted corner list.
struct Node {
  float left, top, edge;
  int begin, end;
  int count() const { return end - begin; }
};

struct FullerFirst {
  /// Among equally full nodes the earlier range comes first, so that the result does not depend on the heap's order.
  bool operator()(const Node& a, const Node& b) const {
    return a.count() != b.count() ? a.count() < b.count() : a.begin > b.begin;
  }
};

using Iterator = std::vector<cv::KeyPoint>::iterator;

/// Children of a node in the order top-left, top-right, bottom-left, bottom-right; empty ones have count 0.
std::array<Node, 4> Split(const Node& node, Iterator corners) {
  const float half = node.edge / 2;
  const float middle_x = node.left + half;
  const float middle_y = node.top + half;
  const auto is_above = [=](const cv::KeyPoint& corner) { return corner.pt.y < middle_y; };
  const auto is_left = [=](const cv::KeyPoint& corner) { return corner.pt.x < middle_x; };
  const Iterator begin = corners + node.begin;
  const Iterator end = corners + node.end;
  const Iterator row_split = std::partition(begin, end, is_above);
  const Iterator top_split = std::partition(begin, row_split, is_left);
  const Iterator bottom_split = std::partition(row_split, end, is_left);
  const auto at = [&](Iterator position) { return static_cast<int>(position - corners); };
  return {Node{node.left, node.top, half, node.begin, at(top_split)},
          Node{middle_x, node.top, half, at(top_split), at(row_split)},
          Node{node.left, middle_y, half, at(row_split), at(bottom_split)},
          Node{middle_x, middle_y, half, at(bottom_split), node.end}};
}

bool StrongerFirst(const cv::KeyPoint& a, const cv::KeyPoint& b) { return a.response > b.response; }

}  // namespace

void SpreadCorners(std::vector<cv::KeyPoint>& corners, int width_px, int height_px, int quota) {
  if (quota <= 0) corners.clear();
  if (static_cast<int>(corners.size()) <= quota) return;

  // Below half a pixel corners at the same place can no longer be told apart.
  constexpr float kMinEdgePx = 0.5F;
  std::priority_queue<Node, std::vector<Node>, FullerFirst> open;
  std::vector<Node> leaves;
  open.push({0, 0, static_cast<float>(std::max(width_px, height_px)), 0, static_cast<int>(corners.size())});
  while (!open.empty() && static_cast<int>(open.size() + leaves.size()) < quota) {
    const Node node = open.top();
    open.pop();
    if (node.count() == 1 || node.edge < kMinEdgePx) {
      leaves.push_back(node);
      continue;
    }
    for (const Node& child : Split(node, corners.begin())) {
      if (child.count() > 0) open.push(child);
    }
  }
  for (; !open.empty(); open.pop()) leaves.push_back(open.top());

  std::vector<cv::KeyPoint> kept;
  kept.reserve(leaves.size());
  for (const Node& leaf : leaves) {
    kept.push_back(*std::min_element(corners.begin() + leaf.begin, corners.begin() + leaf.end, StrongerFirst));
  }
  // The last split may have overshot by up to three leaves: the weakest corners go.
  if (static_cast<int>(kept.size()) > quota) {
    std::nth_element(kept.begin(), kept.begin() + quota, kept.end(), StrongerFirst);
    kept.resize(static_cast<size_t>(quota));
  }
  corners = std::move(kept);
}

}  // namespace mapp::internal
