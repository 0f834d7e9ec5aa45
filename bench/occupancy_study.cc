// Which way of assessing overlap tells a device best what the map holds already? Recorded RGB-D walks with true poses:
// the first is the map, views of the others are the queries. Everything but the poses is the real code: association,
// the server's assessment, codecs, the device's count. Truth, per own point: the map has a point within
// max(5 cm, 5 % of its depth) that was seen from a like direction.

#include "bench/value_or_exit.h"
#include "mapp/base/latency.h"
#include "mapp/codec/keyframe_codec.h"
#include "mapp/codec/occupancy_codec.h"
#include "mapp/view/overlap.h"
#include "server/service/map_service.h"
#include "server/service/overlap_assessor.h"
#include "server/service/view_search.h"
#include "storage/sqlite/sqlite_map_store.h"
#include "tests/support/recorded_walk.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <unistd.h>

namespace mapp {
namespace {

using testing::LoadRecordedWalk;
using testing::RecordedWalk;

constexpr size_t kStride = 5;  // 0.33 s at 15 Hz
constexpr int kNumSamples = 1000;
constexpr double kSeenOverlap = 0.9;

/// A view of the map, and what of it the map truly holds.
struct Query {
  MapView view;
  std::vector<Eigen::Vector3d> own;  ///< camera frame, metres
  std::vector<bool> known;           ///< per own point

  double Overlap() const {
    return static_cast<double>(std::count(known.begin(), known.end(), true)) / static_cast<double>(known.size());
  }
};

/// How a strategy's counts compare with the truth.
class Score {
 public:
  void Add(const Query& query, const OverlapCount& count, size_t answer_bytes) {
    for (size_t i = 0; i < query.own.size(); ++i) {
      ++(query.known[i] ? num_known_ : num_fresh_);
      if (query.known[i] && !count.redundant[i]) ++num_resent_;
      if (!query.known[i] && count.redundant[i]) ++num_lost_;
    }
    const bool seen = query.Overlap() >= kSeenOverlap;
    const bool said = count.overlap >= kSeenOverlap;
    if (seen && said) ++num_hits_;
    if (seen != said) ++num_misses_;
    bias_ += count.overlap - query.Overlap();
    error_ += std::abs(count.overlap - query.Overlap());
    bytes_ += static_cast<double>(answer_bytes);
    max_bytes_ = std::max(max_bytes_, answer_bytes);
    ++num_queries_;
  }
  void Print(const std::string& name) const {
    const double n = num_queries_;
    fmt::print("{:44} {:6.3f} {:6.3f} {:6.3f} {:+7.3f} {:7.3f} {:7.0f} {:6}\n", name,
               2.0 * num_hits_ / std::max(1, 2 * num_hits_ + num_misses_), Share(num_lost_, num_fresh_),
               Share(num_resent_, num_known_), bias_ / n, error_ / n, bytes_ / n, max_bytes_);
  }

 private:
  static double Share(int part, int whole) { return static_cast<double>(part) / std::max(1, whole); }

  int num_queries_ = 0, num_hits_ = 0, num_misses_ = 0;
  int num_known_ = 0, num_fresh_ = 0, num_lost_ = 0, num_resent_ = 0;
  double bias_ = 0, error_ = 0, bytes_ = 0;
  size_t max_bytes_ = 0;
};

std::vector<Eigen::Vector3d> OwnPointsOf(const Keyframe& keyframe, const Camera& camera) {
  std::vector<Eigen::Vector3d> own;
  for (const KeyframeFeature& feature : keyframe.features) {
    if (!feature.point) continue;
    own.emplace_back(feature.point->depth_m * camera.Unproject({feature.keypoint.u_px, feature.keypoint.v_px}));
  }
  return own;
}

/// The map points in reach of the view that neighbor frames saw from a like direction, camera frame.
std::vector<Eigen::Vector3f> PointsInView(TileCache& tiles, const MapView& view) {
  const Eigen::AlignedBox3f everything(Eigen::Vector3f(-3, -3, -2), Eigen::Vector3f(3, 3, 2.5F));
  auto in_reach = ValueOrExit(tiles.TilesInBox(view.map, view.Cone().BoundingBox()), "tiles");
  std::vector<Eigen::Vector3f> points = ViewSearch(view.Cone(), std::move(in_reach)).PointsSeenAlike(everything);
  for (Eigen::Vector3f& point : points) point = FromScaledCoordinates(point);
  return points;
}

void FillTruth(TileCache& tiles, Query& query) {
  const std::vector<Eigen::Vector3f> points = PointsInView(tiles, query.view);
  for (const Eigen::Vector3d& own : query.own) {
    const double reach_m = std::max(0.05, 0.05 * own.z());
    query.known.push_back(std::any_of(points.begin(), points.end(), [&](const Eigen::Vector3f& point) {
      return (point.cast<double>() - own).squaredNorm() <= reach_m * reach_m;
    }));
  }
}

void ScoreSampler(TileCache& tiles, const std::vector<Query>& queries, SamplerKind sampler, const char* name) {
  Score score;
  LatencyRecorder server, device;
  for (const Query& query : queries) {
    const Camera& camera = query.view.camera;
    ViewQuery asked;
    asked.sampler = sampler;
    asked.sketch = MakeQuerySketch(sampler, camera, query.own);
    const Stopwatch assessing;
    const OverlapAnswer answer = ValueOrExit(AssessView(tiles, query.view, asked, kNumSamples), name);
    server.Add(assessing.Elapsed());
    const OverlapQuestion question{camera, query.view.range_m, sampler, asked.sketch, kNumSamples};
    const Stopwatch counting;
    const OverlapCount count = CountOverlap(question, answer, query.own);
    device.Add(counting.Elapsed());
    score.Add(query, count, EncodeOverlapAnswer(answer).size());
  }
  score.Print(
      fmt::format("{} (server {:.2f} ms, device {:.2f} ms)", name, server.Summary().p50_ms, device.Summary().p50_ms));
}

void ScoreBins(TileCache& tiles, const std::vector<Query>& queries, OccupancyResolution resolution, double tolerance,
               SketchRange range) {
  Score score;
  for (const Query& query : queries) {
    const DepthSketch sketch = MakeDepthSketch(query.view.camera, query.own, range);
    const OccupancyGrid grid = ValueOrExit(AssessBins(tiles, query.view, sketch, resolution), "bins");
    OverlapCount count;
    for (const Eigen::Vector3d& own : query.own) {
      const auto location = grid.Locate(query.view.camera, own);
      count.redundant.push_back(location && grid.AnyWithin(*location, tolerance));
    }
    count.overlap = static_cast<double>(std::count(count.redundant.begin(), count.redundant.end(), true)) /
                    static_cast<double>(count.redundant.size());
    score.Add(query, count, EncodeOccupancy(grid).size());
  }
  score.Print(fmt::format("{}x{} columns, {} codes, +-{:.2f} bins, p{:.0f}-p{:.0f}",
                          resolution.subdivision * DepthSketch::kColumns, resolution.subdivision * DepthSketch::kRows,
                          resolution.depth_steps, tolerance, 100 * range.near_share, 100 * range.far_share));
}

int Main(int argc, char** argv) {
  if (argc < 3) {
    fmt::print(stderr, "usage: occupancy_study MAP_SEQUENCE QUERY_SEQUENCE...\n");
    return 2;
  }
  std::string folder = (std::filesystem::temp_directory_path() / "occupancy-study-XXXXXX").string();
  if (mkdtemp(folder.data()) == nullptr) return 1;
  {
    const auto store = ValueOrExit(OpenSqliteMapStore(folder + "/map.db", {.sync_commits = false}), "store");
    const auto service = ValueOrExit(MapService::Create(*store, {}), "service");
    const CallContext context = CallContext::WithTimeout(std::chrono::hours(1));
    const RecordedWalk walk = ValueOrExit(LoadRecordedWalk(argv[1], kStride), argv[1]);
    OpenSessionInput input;
    input.map_name = "study";
    input.device = "founder";
    input.camera = walk.camera;
    input.create_map = true;
    const OpenedSession opened = ValueOrExit(service->OpenSession(context, input), "session");
    for (Keyframe keyframe : walk.keyframes) {
      keyframe.session = opened.session;
      ValueOrExit(service->UploadKeyframe(context, EncodeKeyframe(keyframe)), "upload");
    }
    const Pose3 T_map_world = walk.T_world_session().Inverse();
    TileCache tiles(*store, size_t{256} << 20);
    std::vector<Query> queries;
    for (int i = 2; i < argc; ++i) {
      const RecordedWalk other = ValueOrExit(LoadRecordedWalk(argv[i], kStride), argv[i]);
      for (size_t k = 0; k < other.keyframes.size(); ++k) {
        Query query{
            .view = {opened.map.id, T_map_world * other.T_world_cameras[k], other.camera, opened.map.cone_range_m},
            .own = OwnPointsOf(other.keyframes[k], other.camera),
            .known = {}};
        if (query.own.size() < 50) continue;
        FillTruth(tiles, query);
        queries.push_back(std::move(query));
      }
    }
    const auto num_seen = std::count_if(queries.begin(), queries.end(),
                                        [](const Query& query) { return query.Overlap() >= kSeenOverlap; });
    fmt::print("{} queries, {} of them truly seen\n", queries.size(), num_seen);
    fmt::print("{:44} {:>6} {:>6} {:>6} {:>7} {:>7} {:>7} {:>6}\n", "strategy", "F1", "lost", "resent", "bias",
               "|error|", "bytes", "most");
    ScoreSampler(tiles, queries, SamplerKind::kUniform, "uniform");
    ScoreSampler(tiles, queries, SamplerKind::kDepthSketch, "depth_sketch");
    ScoreSampler(tiles, queries, SamplerKind::kOccupancy, "occupancy");
    for (const int subdivision : {4, 6, 8, 10, 12}) {
      for (const int depth_steps : {1, 2, 3, 4}) {
        for (const double tolerance : {0.0, 0.25, 0.5, 0.75}) {
          ScoreBins(tiles, queries, {subdivision, depth_steps}, tolerance, {.near_share = 0, .far_share = 1});
        }
      }
    }
    for (const SketchRange range : {SketchRange{0.02, 0.98}, SketchRange{0.1, 0.9}}) {
      ScoreBins(tiles, queries, {6, 2}, kOccupancyTolerance, range);
    }
    service->Shutdown();
  }
  std::filesystem::remove_all(folder);
  return 0;
}

}  // namespace
}  // namespace mapp

int main(int argc, char** argv) { return mapp::Main(argc, argv); }
