// Times of what tracking and alignment call most. Inputs are synthetic and seeded; results go to docs/benchmarks.
#include "mapp/base/check.h"
#include "mapp/base/rng.h"
#include "vision/bundle_adjustment.h"
#include "vision/matching.h"
#include "vision/orb_extractor.h"
#include "vision/place_index.h"
#include "vision/pose_optimizer.h"
#include "vision/robust_estimators.h"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace mapp {
namespace {

constexpr PinholeCamera kCamera{525, 525, 320, 240};

/// Squares of random gray at three sizes, so that every pyramid level has corners.
GrayImage TexturedImage(int width_px, int height_px) {
  GrayImage image(width_px, height_px);
  const auto level = [](int square_px, int x, int y) {
    const auto square = static_cast<uint64_t>((y / square_px) * 4099 + x / square_px);
    return 80.0 * Rng(square + static_cast<uint64_t>(square_px) * 1000003).Uniform();
  };
  for (int y = 0; y < height_px; ++y) {
    for (int x = 0; x < width_px; ++x) {
      image.at(x, y) = static_cast<uint8_t>(level(13, x, y) + level(37, x, y) + level(101, x, y));
    }
  }
  return image;
}

/// Real descriptors crowd: on recorded rooms a 20-bit key meets some fifty times as many others as it would if all bits
/// were independent. Here each is one of 200 kinds of corner with every eighth bit flipped, which crowds as much.
OrbDescriptor OrbLikeDescriptor(Rng& rng) {
  Rng kind(rng.Below(200));
  OrbDescriptor descriptor;
  for (uint64_t& word : descriptor.words) word = kind.Next() ^ (rng.Next() & rng.Next() & rng.Next());
  return descriptor;
}

std::vector<OrbDescriptor> OrbLikeDescriptors(size_t count, Rng& rng) {
  std::vector<OrbDescriptor> descriptors;
  for (size_t i = 0; i < count; ++i) descriptors.push_back(OrbLikeDescriptor(rng));
  return descriptors;
}

Eigen::Vector3d PointInView(Rng& rng) {
  const double u_px = rng.Uniform(0, 640);
  const double v_px = rng.Uniform(0, 480);
  return kCamera.Unproject({u_px, v_px}) * rng.Uniform(1, 6);
}

Pose3 SmallMotion(Rng& rng) {
  Eigen::Matrix<double, 6, 1> tangent;
  for (Eigen::Index i = 0; i < 6; ++i) tangent[i] = rng.Uniform(-0.03, 0.03);
  return Pose3::Exp(tangent);
}

void BM_ExtractOrb(benchmark::State& state) {
  const GrayImage image = TexturedImage(static_cast<int>(state.range(0)), static_cast<int>(state.range(1)));
  auto extractor = OrbExtractor::Create({});
  MAPP_CHECK(extractor.ok());
  for (auto _ : state) benchmark::DoNotOptimize((*extractor)->Extract(image.View()));
}
BENCHMARK(BM_ExtractOrb)->Args({640, 480})->Args({752, 480})->Args({1280, 720})->Unit(benchmark::kMillisecond);

void BM_MatchDescriptors(benchmark::State& state) {
  Rng rng(1);
  const auto train = OrbLikeDescriptors(static_cast<size_t>(state.range(0)), rng);
  const auto query = OrbLikeDescriptors(static_cast<size_t>(state.range(0)), rng);
  for (auto _ : state) benchmark::DoNotOptimize(MatchDescriptors(query, train, {}));
}
BENCHMARK(BM_MatchDescriptors)->Arg(1000)->Unit(benchmark::kMillisecond);

void BM_MatchProjected(benchmark::State& state) {
  Rng rng(2);
  std::vector<Feature> features;
  std::vector<FeatureGrid::Point> points;
  std::vector<ProjectedPoint> projected;
  for (int i = 0; i < 1000; ++i) {
    Feature feature;
    feature.keypoint.u_px = static_cast<float>(rng.Uniform(0, 640));
    feature.keypoint.v_px = static_cast<float>(rng.Uniform(0, 480));
    feature.keypoint.octave = static_cast<uint8_t>(rng.Below(kPyramidLevels));
    feature.descriptor = OrbLikeDescriptor(rng);
    features.push_back(feature);
    points.push_back({feature.keypoint.u_px, feature.keypoint.v_px});
    projected.push_back({feature.keypoint.u_px + 4, feature.keypoint.v_px - 3,
                         15.0F * OctaveScale(feature.keypoint.octave), feature.keypoint.octave, feature.descriptor});
  }
  for (auto _ : state) {
    const FeatureGrid grid(points, 640, 480);
    benchmark::DoNotOptimize(MatchProjected(projected, grid, features, {}));
  }
}
BENCHMARK(BM_MatchProjected)->Unit(benchmark::kMicrosecond);

/// A tenth of the observations is false; the start is a frame's motion away.
void BM_OptimizePose(benchmark::State& state) {
  Rng rng(3);
  std::vector<PoseObservation> observations;
  for (int64_t i = 0; i < state.range(0); ++i) {
    const Eigen::Vector3d p_camera = PointInView(rng);
    PoseObservation observation;
    observation.p_world = p_camera;
    observation.pixel = kCamera.Project(p_camera) + Eigen::Vector2d(rng.Normal(), rng.Normal());
    if (i % 10 == 0) observation.pixel.x() += 40;
    observation.depth_m = p_camera.z();
    observations.push_back(observation);
  }
  const Pose3 start = SmallMotion(rng);
  for (auto _ : state) benchmark::DoNotOptimize(OptimizePose(kCamera, observations, start, {}));
}
BENCHMARK(BM_OptimizePose)->Arg(100)->Arg(500)->Unit(benchmark::kMicrosecond);

/// 300 pairs, of which the given percentage is false.
void BM_EstimateRigid(benchmark::State& state) {
  Rng rng(4);
  const Pose3 T_target_source = SmallMotion(rng);
  std::vector<Eigen::Vector3d> source;
  std::vector<Eigen::Vector3d> target;
  for (int64_t i = 0; i < 300; ++i) {
    source.push_back(PointInView(rng));
    target.push_back(i % 100 < state.range(0) ? PointInView(rng) : T_target_source * source.back());
  }
  const std::vector<double> tolerances_m(source.size(), 0.05);
  for (auto _ : state) {
    benchmark::DoNotOptimize(EstimateRigid(source, target, tolerances_m, /*with_scale=*/false, {}));
  }
}
BENCHMARK(BM_EstimateRigid)->Arg(30)->Arg(70)->Unit(benchmark::kMicrosecond);

void BM_EstimatePose(benchmark::State& state) {
  Rng rng(5);
  const Pose3 T_camera_world = SmallMotion(rng);
  std::vector<Eigen::Vector3d> p_world;
  std::vector<Eigen::Vector2d> pixels;
  for (int64_t i = 0; i < 300; ++i) {
    p_world.push_back(PointInView(rng));
    const Eigen::Vector3d seen = i % 100 < state.range(0) ? PointInView(rng) : T_camera_world * p_world.back();
    pixels.push_back(kCamera.Project(seen));
  }
  for (auto _ : state) benchmark::DoNotOptimize(EstimatePose(kCamera, p_world, pixels, 4.0, {}));
}
BENCHMARK(BM_EstimatePose)->Arg(30)->Arg(70)->Unit(benchmark::kMicrosecond);

/// Frames along a path, each point seen by four successive ones.
BundleProblem PathProblem(int num_frames, int num_points) {
  Rng rng(6);
  BundleProblem problem;
  for (int i = 0; i < num_frames; ++i) {
    const Pose3 T_world_camera(Eigen::Quaterniond::Identity(), {0.1 * i, 0, 0});
    problem.frames.push_back({.camera = kCamera, .T_world_camera = T_world_camera, .fixed = i < 2});
  }
  for (int point_idx = 0; point_idx < num_points; ++point_idx) {
    const int first = static_cast<int>(rng.Below(static_cast<uint64_t>(std::max(1, num_frames - 3))));
    problem.points.push_back({.p_world = Eigen::Vector3d(0.1 * first, 0, 0) + PointInView(rng)});
    for (int frame_idx = first; frame_idx < std::min(num_frames, first + 4); ++frame_idx) {
      const Pose3& T_world_camera = problem.frames[static_cast<size_t>(frame_idx)].T_world_camera;
      const Eigen::Vector3d p_camera = T_world_camera.Inverse() * problem.points.back().p_world;
      const Eigen::Vector2d noise(rng.Normal(), rng.Normal());
      problem.observations.push_back({.frame_idx = frame_idx,
                                      .point_idx = point_idx,
                                      .pixel = kCamera.Project(p_camera) + noise,
                                      .depth_m = point_idx % 2 == 0 ? p_camera.z() : 0.0});
    }
  }
  for (BundleProblem::Frame& frame : problem.frames) {
    if (!frame.fixed) frame.T_world_camera = frame.T_world_camera * SmallMotion(rng);
  }
  return problem;
}

void BM_AdjustBundle(benchmark::State& state) {
  const BundleProblem start = PathProblem(static_cast<int>(state.range(0)), static_cast<int>(state.range(1)));
  BundleOptions options;
  options.max_iterations = 5;
  for (auto _ : state) {
    BundleProblem problem = start;
    const auto result = AdjustBundle(problem, options);
    MAPP_CHECK(result.ok());
    state.counters["rmse_px"] = result->final_rmse_px;
    state.counters["iterations"] = result->num_iterations;
  }
}
BENCHMARK(BM_AdjustBundle)->Args({10, 2000})->Args({500, 50000})->Unit(benchmark::kMillisecond);

/// Frames of 1000 descriptors each, by frame number alone.
std::vector<OrbDescriptor> FrameDescriptors(uint64_t frame) {
  Rng rng(1000 + frame);
  return OrbLikeDescriptors(1000, rng);
}

/// An index of `num_frames` frames. Grown, not rebuilt, from call to call: the arguments below ascend.
const PlaceIndex& IndexOf(uint64_t num_frames) {
  static PlaceIndex index{PlaceIndex::Options{}};
  for (uint64_t frame = index.num_frames(); frame < num_frames; ++frame) index.Add(frame, FrameDescriptors(frame));
  return index;
}

/// The query has 1000 descriptors, 300 of them those of one frame with 30 bits of noise.
void BM_QueryPlaceIndex(benchmark::State& state) {
  const auto num_frames = static_cast<uint64_t>(state.range(0));
  const PlaceIndex& index = IndexOf(num_frames);
  Rng rng(7);
  std::vector<OrbDescriptor> query = FrameDescriptors(num_frames / 2);
  for (size_t i = 0; i < query.size(); ++i) {
    if (i >= 300) query[i] = OrbLikeDescriptor(rng);
    for (int flip = 0; flip < 30; ++flip) query[i].words[rng.Below(4)] ^= uint64_t{1} << rng.Below(64);
  }
  for (auto _ : state) {
    const auto candidates = index.Query(query, 10);
    MAPP_CHECK(!candidates.empty());
    state.counters["found"] = candidates[0].frame == num_frames / 2;
  }
}
BENCHMARK(BM_QueryPlaceIndex)->Arg(100)->Arg(1000)->Arg(10000)->Unit(benchmark::kMillisecond);

void BM_AddToPlaceIndex(benchmark::State& state) {
  PlaceIndex index{PlaceIndex::Options{}};
  uint64_t frame = 0;
  for (; frame < 1000; ++frame) index.Add(frame, FrameDescriptors(frame));
  const auto descriptors = FrameDescriptors(frame);
  for (auto _ : state) {
    index.Add(frame, descriptors);
    index.Remove(frame++);
  }
}
BENCHMARK(BM_AddToPlaceIndex)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace mapp
