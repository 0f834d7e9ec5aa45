#include "mapp/view/sampler.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

namespace mapp {
namespace {

/// Additive recurrence with the plastic number's powers: well spread in three dimensions for any count
/// (Roberts 2018, R3 sequence). In 32-bit integers, so that both sides of the wire get the same points.
constexpr std::array<uint32_t, 3> kR3Steps = {3518319155U, 2882110345U, 2360945575U};

std::array<double, 3> LowDiscrepancy(uint32_t index, uint32_t seed) {
  std::array<double, 3> point{};
  for (size_t i = 0; i < 3; ++i) {
    const uint32_t value = 0x80000000U + kR3Steps[i] * (index + 1 + 97U * seed);
    point[i] = value * 0x1.0p-32;
  }
  return point;
}

/// Lowest radius in scaled coordinates (OVERLAP study).
constexpr double kMinScaledRadius = 0.06;

/// ln-depth range of a cell in units of code steps, padding included; integer, so that both sides share samples alike.
int CodeSpan(const DepthSketch::Cell& cell) {
  // kLnDepthPadding at both ends: 0.16 of ln depth is 5.9 of the 254 steps that span ln 1000.
  constexpr int kPaddingSteps = 6;
  return cell.near_code == 0 ? 0 : cell.far_code - cell.near_code + kPaddingSteps;
}

struct CellBounds {
  double u0, v0, u1, v1;   // pixels
  double ln_near, ln_far;  // of metres, padded
};

CellBounds BoundsOf(const Camera& camera, const DepthSketch& sketch, int cell) {
  const int column = cell % DepthSketch::kColumns;
  const int row = cell / DepthSketch::kColumns;
  const double cell_width = static_cast<double>(camera.width_px) / DepthSketch::kColumns;
  const double cell_height = static_cast<double>(camera.height_px) / DepthSketch::kRows;
  const DepthSketch::Cell& depths = sketch.cells[static_cast<size_t>(cell)];
  return {column * cell_width - 0.5,
          row * cell_height - 0.5,
          (column + 1) * cell_width - 0.5,
          (row + 1) * cell_height - 0.5,
          std::log(DepthSketch::DecodeDepth(depths.near_code)) - kLnDepthPadding,
          std::log(DepthSketch::DecodeDepth(depths.far_code)) + kLnDepthPadding};
}

/// Volume of a cell in scaled coordinates: area on the plane z = 1 times half the ln-depth range.
double ScaledVolume(const Camera& camera, const CellBounds& bounds) {
  const Eigen::Vector2d f = camera.FocalLengths();
  const double area = (bounds.u1 - bounds.u0) / f.x() * (bounds.v1 - bounds.v0) / f.y();
  return area * 0.5 * (bounds.ln_far - bounds.ln_near);
}

/// Indices of the (at most) four nearest samples and their squared distances, brute force over a few thousand floats.
struct Nearest {
  std::array<float, 4> squared_distance;
  std::array<int, 4> index;
};

Nearest FindNearest(const std::vector<Eigen::Vector3f>& samples, const Eigen::Vector3f& point) {
  Nearest nearest;
  nearest.squared_distance.fill(std::numeric_limits<float>::max());
  nearest.index.fill(-1);
  for (size_t i = 0; i < samples.size(); ++i) {
    const float d2 = (samples[i] - point).squaredNorm();
    if (d2 >= nearest.squared_distance[3]) continue;
    size_t slot = 3;
    while (slot > 0 && nearest.squared_distance[slot - 1] > d2) {
      nearest.squared_distance[slot] = nearest.squared_distance[slot - 1];
      nearest.index[slot] = nearest.index[slot - 1];
      --slot;
    }
    nearest.squared_distance[slot] = d2;
    nearest.index[slot] = static_cast<int>(i);
  }
  return nearest;
}

bool RedundantByVote(const std::vector<Eigen::Vector3f>& scaled_samples, const std::vector<bool>& sample_redundant,
                     float radius, const Eigen::Vector3d& point) {
  if (point.z() <= 0) return false;
  const Nearest nearest = FindNearest(scaled_samples, ScaledCoordinates(point.cast<float>()));
  if (nearest.index[0] < 0 || nearest.squared_distance[0] > 9 * radius * radius) return false;
  int votes = 0;
  for (const int index : nearest.index) {
    if (index >= 0 && sample_redundant[static_cast<size_t>(index)]) ++votes;
  }
  return votes > 2;
}

bool RedundantByBall(const SampleSet& samples, const std::vector<bool>& sample_redundant,
                     const Eigen::Vector3d& point) {
  const Eigen::Vector3f p = point.cast<float>();
  const float r2 = samples.radius * samples.radius;
  for (size_t i = 0; i < samples.p_camera.size(); ++i) {
    if (sample_redundant[i] && (samples.p_camera[i] - p).squaredNorm() <= r2) return true;
  }
  return false;
}

}  // namespace

SampleSet SampleUniform(double field_of_view, double range_m, int num_samples) {
  SampleSet set;
  set.kind = SamplerKind::kUniform;
  if (num_samples <= 0) return set;
  const double half_angle = std::min(0.5 * field_of_view, std::numbers::pi);
  const double cos_half = std::cos(half_angle);
  const double volume = 2.0 / 3.0 * std::numbers::pi * range_m * range_m * range_m * (1 - cos_half);
  set.radius = static_cast<float>(std::cbrt(volume / num_samples));
  set.p_camera.reserve(static_cast<size_t>(num_samples));
  for (int i = 0; i < num_samples; ++i) {
    // Uniform in volume: r^3, cos(angle) and azimuth are each uniform.
    const std::array<double, 3> unit = LowDiscrepancy(static_cast<uint32_t>(i), 0);
    const double r = range_m * std::cbrt(unit[0]);
    const double cos_angle = 1 - unit[1] * (1 - cos_half);
    const double sin_angle = std::sqrt(std::max(0.0, 1 - cos_angle * cos_angle));
    const double azimuth = 2 * std::numbers::pi * unit[2];
    const Eigen::Vector3d p(r * sin_angle * std::cos(azimuth), r * sin_angle * std::sin(azimuth), r * cos_angle);
    set.p_camera.emplace_back(p.cast<float>());
  }
  return set;
}

SampleSet SampleDepthSketch(const Camera& camera, const DepthSketch& sketch, int num_samples) {
  SampleSet set;
  set.kind = SamplerKind::kDepthSketch;
  int total_span = 0;
  for (const DepthSketch::Cell& cell : sketch.cells) total_span += CodeSpan(cell);
  if (total_span == 0 || num_samples <= 0) return set;
  double volume = 0;
  int spans_before = 0;
  for (int cell = 0; cell < DepthSketch::kCells; ++cell) {
    const int span = CodeSpan(sketch.cells[static_cast<size_t>(cell)]);
    if (span == 0) continue;
    // Differences of the running share: they add up to num_samples exactly.
    const int64_t first = int64_t{num_samples} * spans_before / total_span;
    spans_before += span;
    const int64_t last = int64_t{num_samples} * spans_before / total_span;
    const CellBounds bounds = BoundsOf(camera, sketch, cell);
    volume += ScaledVolume(camera, bounds);
    for (int64_t i = 0; i < last - first; ++i) {
      const std::array<double, 3> unit = LowDiscrepancy(static_cast<uint32_t>(i), static_cast<uint32_t>(cell));
      const Eigen::Vector2d pixel(bounds.u0 + unit[0] * (bounds.u1 - bounds.u0),
                                  bounds.v0 + unit[1] * (bounds.v1 - bounds.v0));
      const double depth = std::exp(bounds.ln_near + unit[2] * (bounds.ln_far - bounds.ln_near));
      set.p_camera.emplace_back((depth * camera.Unproject(pixel)).cast<float>());
    }
  }
  set.radius = static_cast<float>(std::max(std::cbrt(volume / num_samples), kMinScaledRadius));
  return set;
}

OverlapCount CountBySamples(const SampleSet& samples, const std::vector<bool>& sample_redundant,
                            std::span<const Eigen::Vector3d> own_points) {
  OverlapCount count;
  count.redundant.assign(own_points.size(), false);
  if (own_points.empty() || sample_redundant.size() != samples.p_camera.size()) return count;
  std::vector<Eigen::Vector3f> scaled;
  if (samples.kind == SamplerKind::kDepthSketch) {
    scaled.reserve(samples.p_camera.size());
    for (const Eigen::Vector3f& p : samples.p_camera) scaled.push_back(ScaledCoordinates(p));
  }
  size_t num_redundant = 0;
  for (size_t i = 0; i < own_points.size(); ++i) {
    const bool redundant = samples.kind == SamplerKind::kDepthSketch
                               ? RedundantByVote(scaled, sample_redundant, samples.radius, own_points[i])
                               : RedundantByBall(samples, sample_redundant, own_points[i]);
    count.redundant[i] = redundant;
    num_redundant += redundant ? 1 : 0;
  }
  count.overlap = static_cast<double>(num_redundant) / static_cast<double>(own_points.size());
  return count;
}

}  // namespace mapp
