#pragma once

#include "mapp/camera/camera_model.h"

#include <array>
#include <cstdint>
#include <span>

namespace mapp {

/// Each cell's ln-depth range is widened by this at both ends when it is sampled (OVERLAP study).
inline constexpr double kLnDepthPadding = 0.08;

/// Depth range of a keyframe's own points in 4 x 3 image cells: two percentiles, a byte each on a log scale
/// (DESIGN 4, 5). Code 0 = the cell has no points; else depth = 0.1 m * 1000^((code - 1) / 254).
struct DepthSketch {
  static constexpr int kColumns = 4;
  static constexpr int kRows = 3;
  static constexpr int kCells = kColumns * kRows;
  struct Cell {
    uint8_t near_code = 0;
    uint8_t far_code = 0;
    friend bool operator==(const Cell&, const Cell&) = default;
  };
  std::array<Cell, kCells> cells{};  ///< row-major from the top left
  friend bool operator==(const DepthSketch&, const DepthSketch&) = default;

  static uint8_t EncodeDepth(double depth_m);  ///< clamps to [0.1, 100] m
  static double DecodeDepth(uint8_t code) { return DepthOfCode(code); }
  /// The code's scale, continued between and beyond the codes.
  static double CodeOfDepth(double depth_m);
  static double DepthOfCode(double code);
  bool empty() const;
  /// Greatest depth that any sample drawn from this sketch can have, metres.
  double FarthestDepth() const;
};

/// Which percentiles of a cell's depths are told, as shares; range [0, 1].
struct SketchRange {
  double near_share = 0.1;
  double far_share = 0.9;
};

/// `p_camera`: the keyframe's map points in the camera's frame, metres, z > 0.
DepthSketch MakeDepthSketch(const Camera& camera, std::span<const Eigen::Vector3d> p_camera, SketchRange range = {});

}  // namespace mapp
