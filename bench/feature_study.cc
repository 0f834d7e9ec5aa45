// How close the feature level comes to rendered images: for pairs of views of a garage, taken by one user a few frames
// apart or by two users who pass the same place, how many features of one view are found again in the other, and how
// many of these by their descriptors. Depth and poses are the truth.

#include "bench/value_or_exit.h"
#include "sim/features/feature_camera.h"
#include "sim/room.h"
#include "sim/world/visit_sequence.h"
#include "vision/orb_extractor.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <map>
#include <memory>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

namespace mapp::sim {
namespace {

constexpr size_t kStride = 12;          ///< between the frames of a user that are looked at
constexpr double kMinBaseline_m = 0.0;  ///< of pairs of two users
constexpr double kMaxBaseline_m = 4;
constexpr double kMaxTurn_deg = 30;
constexpr size_t kMaxPairs = 150;  ///< of two users
constexpr std::array<size_t, 5> kApart = {1, 3, 6, 12, 24};
constexpr double kRadius_px = 2.5;      ///< of its octave: at most so far from where it should be, a feature is found
constexpr double kMaxOctavesOff = 1.5;  ///< and so many octaves
constexpr int kMaxBits = 64;            ///< of a match
constexpr double kBorder_px = 19;
constexpr double kDegrees = 180 / std::numbers::pi;

struct Seen {
  Feature feature;
  Eigen::Vector3d p_world;
  bool at_edge = false;  ///< what surrounds it does not lie in one plane
};

struct View {
  const Camera* camera = nullptr;
  Pose3 T_world_camera;
  DepthImage depth_m;  ///< without noise
  std::vector<Seen> rendered;
  std::vector<Seen> simulated;
};

/// What became of one feature in another view.
struct Fate {
  bool found = false;
  bool matched = false;  ///< the nearest descriptor of all is near and stands at the right place
  bool wrong = false;    ///< ... or at a wrong one
  int bits = 0;          ///< if matched
};

struct Tally {
  int count = 0, found = 0, matched = 0, wrong = 0;
  std::vector<int> bits;

  void Add(const Fate& fate) {
    ++count;
    found += fate.found ? 1 : 0;
    matched += fate.matched ? 1 : 0;
    wrong += fate.wrong ? 1 : 0;
    if (fate.matched) bits.push_back(fate.bits);
  }
  double Share(int part) const { return static_cast<double>(part) / std::max(1, count); }
  int MedianBits() {
    if (bits.empty()) return 0;
    const auto middle = bits.begin() + static_cast<ptrdiff_t>(bits.size() / 2);
    std::nth_element(bits.begin(), middle, bits.end());
    return *middle;
  }
};

/// Of rendered views and of the feature level.
using Both = std::array<Tally, 2>;

void Print(const std::map<std::string, Both>& rows) {
  fmt::print("{:26} {:>15} {:>11} {:>11} {:>11} {:>9}\n", "rendered | features", "count", "found", "matched", "wrong",
             "bits");
  for (const auto& [name, row] : rows) {
    Both both = row;
    fmt::print("{:26} {:>7} {:>7}", name, both[0].count, both[1].count);
    for (const auto part : {&Tally::found, &Tally::matched, &Tally::wrong}) {
      fmt::print("   {:.2f} {:.2f}", both[0].Share(both[0].*part), both[1].Share(both[1].*part));
    }
    fmt::print("   {:3} {:3}\n", both[0].MedianBits(), both[1].MedianBits());
  }
  fmt::print("\n");
}

/// A user's way, both as images and without.
struct Walk {
  std::unique_ptr<Sequence> sequence;
  std::unique_ptr<FeatureCamera> features;
};

class Study {
 public:
  explicit Study(std::vector<Walk> walks)
      : walks_(std::move(walks)), extractor_(ValueOrExit(OrbExtractor::Create({}))) {}

  void Run() {
    CompareFramesOfOneUser();
    if (walks_.size() > 1) CompareUsers();
    CompareOctaves();
    CompareDistances();
    if (walks_.size() > 1) CompareAcrossOctaves();
  }

 private:
  const View& Look(size_t user, size_t frame) {
    const auto [at, is_new] = views_.try_emplace({user, frame});
    View& view = at->second;
    if (!is_new) return view;
    const Walk& walk = walks_[user];
    SequenceFrame drawn = ValueOrExit(walk.sequence->Read(frame));
    view.camera = &walk.sequence->camera();
    view.T_world_camera = walk.sequence->ground_truth().at(frame).T_world_camera;
    view.depth_m = std::move(drawn.depth_m);
    const auto on_surface = [&](const Keypoint& keypoint) -> Eigen::Vector3d {
      const Eigen::Vector2d pixel(keypoint.u_px, keypoint.v_px);
      return view.T_world_camera * (DepthAt(view, pixel) * view.camera->Unproject(pixel));
    };
    for (const Feature& feature : ValueOrExit(extractor_->Extract(drawn.gray.View()))) {
      view.rendered.push_back({feature, on_surface(feature.keypoint), AtEdge(view, feature.keypoint)});
    }
    for (const ObservedFeature& seen : walk.features->Observe(view.T_world_camera, drawn.stamp_ns)) {
      // Clutter stands nowhere: at the depth of what the picture shows there.
      const Keypoint& keypoint = seen.feature.keypoint;
      view.simulated.push_back(
          {seen.feature, seen.landmark != 0 ? seen.p_world : on_surface(keypoint), AtEdge(view, keypoint)});
    }
    return view;
  }

  /// Over a plane inverse depth is linear.
  static bool AtEdge(const View& view, const Keypoint& keypoint) {
    const Eigen::Vector2d center(keypoint.u_px, keypoint.v_px);
    const double radius_px = 4 * static_cast<double>(OctaveScale(keypoint.octave));
    const double inverse = 1 / DepthAt(view, center);
    constexpr int kDirections = 8;
    for (int i = 0; i < kDirections; ++i) {
      const double angle = std::numbers::pi * i / kDirections;
      const Eigen::Vector2d off = radius_px * Eigen::Vector2d(std::cos(angle), std::sin(angle));
      if (!view.camera->Contains(center + off) || !view.camera->Contains(center - off)) continue;
      const double mean = 0.5 / DepthAt(view, center + off) + 0.5 / DepthAt(view, center - off);
      if (!(std::abs(mean - inverse) < 0.015 * inverse)) return true;
    }
    return false;
  }

  static double DepthAt(const View& view, const Eigen::Vector2d& pixel) {
    return static_cast<double>(
        view.depth_m.at(static_cast<int>(std::lround(pixel.x())), static_cast<int>(std::lround(pixel.y()))));
  }

  /// Calls `add` with each feature of `from` that should be seen in `to`, and what became of it.
  template <typename Add>
  void Compare(const View& from, const View& to, bool simulated, const Add& add) const {
    const std::vector<Seen>& seen = simulated ? from.simulated : from.rendered;
    const std::vector<Seen>& others = simulated ? to.simulated : to.rendered;
    const Pose3 T_camera_world = to.T_world_camera.Inverse();
    for (const Seen& one : seen) {
      const Eigen::Vector3d p_camera = T_camera_world * one.p_world;
      if (!(p_camera.z() > 0.3)) continue;
      const Eigen::Vector2d pixel = to.camera->Project(p_camera);
      const Eigen::Vector3d from_eye = one.p_world - from.T_world_camera.translation();
      const Eigen::Vector3d to_eye = one.p_world - to.T_world_camera.translation();
      const double octaves_up =
          std::log(to.camera->FocalLengths().x() / from.camera->FocalLengths().x() * from_eye.norm() / to_eye.norm()) /
          std::log(double{kPyramidScale});
      const double octave = one.feature.keypoint.octave + octaves_up;
      if (!(octave > -0.5 && octave < kPyramidLevels - 0.5)) continue;
      if (!to.camera->Contains(pixel, kBorder_px * std::pow(kPyramidScale, std::max(octave, 0.0)))) continue;
      // Hidden, or at an edge.
      if (std::abs(DepthAt(to, pixel) - p_camera.z()) > 0.01 + 0.01 * p_camera.z()) continue;
      const double degrees =
          kDegrees * std::acos(std::clamp(from_eye.dot(to_eye) / (from_eye.norm() * to_eye.norm()), -1.0, 1.0));
      add(FateOf(one.feature, pixel, octave, others), degrees, octaves_up, one);
    }
  }

  static Fate FateOf(const Feature& feature, const Eigen::Vector2d& pixel, double octave,
                     const std::vector<Seen>& others) {
    const auto is_there = [&](const Keypoint& keypoint) {
      const double radius_px = kRadius_px * static_cast<double>(OctaveScale(keypoint.octave));
      return (Eigen::Vector2d(keypoint.u_px, keypoint.v_px) - pixel).squaredNorm() <= radius_px * radius_px;
    };
    Fate fate;
    int least = 257;
    const Keypoint* nearest = nullptr;
    for (const Seen& other : others) {
      const Keypoint& keypoint = other.feature.keypoint;
      fate.found |= std::abs(keypoint.octave - octave) <= kMaxOctavesOff && is_there(keypoint);
      const int bits = HammingDistance(feature.descriptor, other.feature.descriptor);
      if (bits >= least) continue;
      least = bits;
      nearest = &keypoint;
    }
    if (nearest == nullptr || least > kMaxBits) return fate;
    (is_there(*nearest) ? fate.matched : fate.wrong) = true;
    fate.bits = least;
    return fate;
  }

  void CompareFramesOfOneUser() {
    std::map<std::string, Both> rows;
    for (size_t frame = 0; frame + kApart.back() < walks_[0].sequence->ground_truth().size(); frame += kStride) {
      for (const size_t apart : kApart) {
        for (const bool simulated : {false, true}) {
          Tally& tally = rows[fmt::format("{:2} frames apart", apart)][simulated ? 1 : 0];
          Compare(Look(0, frame), Look(0, frame + apart), simulated,
                  [&](const Fate& fate, double, double, const Seen&) { tally.Add(fate); });
        }
      }
    }
    Print(rows);
  }

  std::vector<std::pair<size_t, size_t>> PairsOfUsers() const {
    std::vector<std::pair<size_t, size_t>> pairs;
    const auto& first = walks_[0].sequence->ground_truth();
    const auto& second = walks_[1].sequence->ground_truth();
    for (size_t i = 0; i < first.size(); i += kStride) {
      for (size_t j = 0; j < second.size(); j += kStride) {
        const double baseline_m =
            (first[i].T_world_camera.translation() - second[j].T_world_camera.translation()).norm();
        const double turn_deg =
            kDegrees * first[i].T_world_camera.rotation().angularDistance(second[j].T_world_camera.rotation());
        if (baseline_m >= kMinBaseline_m && baseline_m <= kMaxBaseline_m && turn_deg <= kMaxTurn_deg) {
          pairs.emplace_back(i, j);
        }
      }
    }
    const size_t every = std::max<size_t>(1, pairs.size() / kMaxPairs);
    std::vector<std::pair<size_t, size_t>> kept;
    for (size_t i = 0; i < pairs.size(); i += every) kept.push_back(pairs[i]);
    return kept;
  }

  void CompareUsers() {
    const auto pairs = PairsOfUsers();
    fmt::print("{} pairs of views of two users\n", pairs.size());
    std::map<std::string, Both> by_baseline, by_angle, by_scale, by_octave;
    for (const auto& [first, second] : pairs) {
      const View& from = Look(0, first);
      const View& to = Look(1, second);
      const double baseline_m = (from.T_world_camera.translation() - to.T_world_camera.translation()).norm();
      for (const bool simulated : {false, true}) {
        const size_t kind = simulated ? 1 : 0;
        Compare(from, to, simulated, [&](const Fate& fate, double degrees, double octaves_up, const Seen& seen) {
          by_baseline[fmt::format("baseline up to {} m", baseline_m < 1 ? 1 : baseline_m < 2 ? 2 : 4)][kind].Add(fate);
          by_baseline["of all"][kind].Add(fate);
          by_angle[fmt::format("{} {:2}..{:2} deg", seen.at_edge ? "edge" : "amid",
                               5 * static_cast<int>(std::min(degrees, 39.0) / 5),
                               5 * static_cast<int>(std::min(degrees, 39.0) / 5) + 5)][kind]
              .Add(fate);
          by_scale[fmt::format("larger by octaves {:+d}", std::clamp(static_cast<int>(std::lround(octaves_up)), -5, 5))]
                  [kind]
                      .Add(fate);
          by_octave[fmt::format("octave {}", seen.feature.keypoint.octave)][kind].Add(fate);
          by_baseline[seen.at_edge ? "of all at edges" : "of all amid a surface"][kind].Add(fate);
        });
      }
    }
    Print(by_baseline);
    Print(by_angle);
    Print(by_scale);
    Print(by_octave);
  }

  void CompareDistances() const {
    fmt::print("features a view by distance, m (those at edges)\n");
    for (const bool simulated : {false, true}) {
      std::map<int, std::array<int, 2>> counts;
      for (const auto& [key, view] : views_) {
        for (const Seen& seen : simulated ? view.simulated : view.rendered) {
          const double distance_m = (seen.p_world - view.T_world_camera.translation()).norm();
          std::array<int, 2>& count = counts[std::clamp(static_cast<int>(std::floor(2 * std::log2(distance_m))), 0, 8)];
          ++count[0];
          count[1] += seen.at_edge ? 1 : 0;
        }
      }
      for (const auto& [bin, count] : counts) {
        const auto views = static_cast<double>(views_.size());
        fmt::print("  {:.1f}: {:.0f} ({:.0f})", std::exp2(0.5 * bin), count[0] / views, count[1] / views);
      }
      fmt::print("\n");
    }
  }

  /// How many features of one user's view the other's shows at the same place so many octaves above the expected one,
  /// and how many of these look alike: a corner is one at several sizes.
  void CompareAcrossOctaves() {
    constexpr int kMaxOff = 3;
    constexpr double kMaxAngle_deg = 8;
    fmt::print("found so many octaves off (alike)\n");
    for (const bool simulated : {false, true}) {
      std::map<int, std::array<int, 3>> counts;  // all, found, alike
      for (const auto& [first, second] : PairsOfUsers()) {
        const View& from = Look(0, first);
        const View& to = Look(1, second);
        Compare(from, to, simulated, [&](const Fate&, double degrees, double octaves_up, const Seen& seen) {
          if (degrees > kMaxAngle_deg) return;
          const Eigen::Vector2d pixel = to.camera->Project(to.T_world_camera.Inverse() * seen.p_world);
          const int expected = static_cast<int>(std::lround(seen.feature.keypoint.octave + octaves_up));
          for (int off = -kMaxOff; off <= kMaxOff; ++off) {
            if (expected + off < 0 || expected + off >= kPyramidLevels) continue;
            const int least = NearestBits(seen.feature, pixel, expected + off, simulated ? to.simulated : to.rendered);
            std::array<int, 3>& count = counts[off];
            ++count[0];
            count[1] += least <= 256 ? 1 : 0;
            count[2] += least <= kMaxBits ? 1 : 0;
          }
        });
      }
      for (const auto& [off, count] : counts) {
        const double all = count[0];
        fmt::print("  {:+}: {:.2f} ({:.3f})", off, count[1] / all, count[2] / all);
      }
      fmt::print("\n");
    }
  }

  /// The nearest descriptor of an octave at a place; 257 without any.
  static int NearestBits(const Feature& feature, const Eigen::Vector2d& pixel, int octave,
                         const std::vector<Seen>& others) {
    int least = 257;
    const double radius_px = kRadius_px * static_cast<double>(OctaveScale(octave));
    for (const Seen& other : others) {
      const Keypoint& at = other.feature.keypoint;
      if (at.octave != octave || (Eigen::Vector2d(at.u_px, at.v_px) - pixel).norm() > radius_px) continue;
      least = std::min(least, HammingDistance(feature.descriptor, other.feature.descriptor));
    }
    return least;
  }

  void CompareOctaves() const {
    std::array<std::array<int, kPyramidLevels>, 2> counts{};
    for (const auto& [key, view] : views_) {
      for (const Seen& seen : view.rendered) ++counts[0][seen.feature.keypoint.octave];
      for (const Seen& seen : view.simulated) ++counts[1][seen.feature.keypoint.octave];
    }
    for (const auto& row : counts) {
      fmt::print("features a view by octave:");
      for (const int count : row)
        fmt::print(" {:6.1f}", static_cast<double>(count) / static_cast<double>(views_.size()));
      fmt::print("\n");
    }
  }

  const std::vector<Walk> walks_;
  const std::unique_ptr<OrbExtractor> extractor_;
  std::map<std::pair<size_t, size_t>, View> views_;  ///< by user and frame
};

/// Gray levels as noisy as a device's, depth exact.
SensorNoise GrayNoise() { return {.depth_sigma_per_m = 0, .max_depth_m = std::numeric_limits<double>::infinity()}; }

std::vector<Walk> WalksInGarage() {
  SimulationOptions options;
  options.path_m = 40;
  options.rate_hz = 15;
  const auto simulation = ValueOrExit(Simulate(options));
  const auto world = std::make_shared<const FeatureWorld>(simulation->world);
  std::vector<Walk> walks;
  for (int user = 0; user < options.num_users; ++user) {
    const CameraRig& rig = simulation->visits[static_cast<size_t>(user)].rig;
    walks.push_back({ValueOrExit(OpenVisit(simulation, user, {.noise = GrayNoise()})),
                     ValueOrExit(FeatureCamera::Create(world, rig, {}, static_cast<uint64_t>(user)))});
  }
  return walks;
}

std::vector<Walk> WalkInRoom() {
  auto world = std::make_shared<World>();
  world->surroundings = *ValueOrExit(BuildRoom(1));
  CameraRig rig;
  rig.camera = RoomCamera();
  std::vector<Walk> walks;
  walks.push_back(
      {ValueOrExit(MakeRoomSequence({.noise = GrayNoise()})),
       ValueOrExit(FeatureCamera::Create(std::make_shared<const FeatureWorld>(std::move(world)), rig, {}, 0))});
  return walks;
}

int Main() {
  fmt::print("A room\n\n");
  Study(WalkInRoom()).Run();
  fmt::print("\nA garage\n\n");
  Study(WalksInGarage()).Run();
  return 0;
}

}  // namespace
}  // namespace mapp::sim

int main() { return mapp::sim::Main(); }
