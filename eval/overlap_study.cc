#include "eval/overlap_study.h"

#include "client_sdk/src/redundancy_control.h"
#include "eval/study_map.h"
#include "mapp/base/rng.h"
#include "mapp/codec/keyframe_codec.h"
#include "mapp/codec/query_codec.h"
#include "server/service/overlap_assessor.h"
#include "storage/map_store.h"
#include "storage/sqlite/sqlite_map_store.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <unordered_map>
#include <utility>

namespace mapp {
namespace {

/// A keyframe that the map is asked about.
struct Query {
  MapView view;
  OwnPoints own;
  std::vector<Feature> features;  ///< those of the own points
};

/// What a strategy made of a query.
struct Answered {
  OverlapCount count;
  size_t query_bytes = 0;
  size_t answer_bytes = 0;
};

struct Truth {
  std::vector<bool> by_geometry;
  std::vector<bool> by_descriptor;
};

Status CheckOptions(const OverlapStudyOptions& options) {
  if (options.query_sessions.empty()) return absl::InvalidArgumentError("query_sessions: must name a session");
  if (options.samplers.empty()) return absl::InvalidArgumentError("samplers: must name one");
  const std::set<SessionId> unique(options.query_sessions.begin(), options.query_sessions.end());
  if (unique.size() != options.query_sessions.size()) {
    return absl::InvalidArgumentError("query_sessions: names a session twice");
  }
  if (options.num_samples < 1 || options.num_samples > kMaxFeatures) {
    return absl::InvalidArgumentError(
        fmt::format("num_samples: must be in [1, {}], got {}", kMaxFeatures, options.num_samples));
  }
  return absl::OkStatus();
}

Status CheckSessions(MapReader& reader, const MapRecord& map, const OverlapStudyOptions& options) {
  for (const SessionId id : options.query_sessions) {
    MAPP_ASSIGN_OR_RETURN(const SessionRecord session, reader.GetSession(id));
    if (session.map != map.id) {
      return absl::InvalidArgumentError(
          fmt::format("query_sessions: session {} is not one of map \"{}\"", id.value(), map.name));
    }
  }
  return absl::OkStatus();
}

Pose3 Shaken(const Pose3& T_map_camera, const OverlapStudyOptions& options, Rng& rng) {
  Eigen::Matrix<double, 6, 1> tangent;
  for (int i = 0; i < 6; ++i) tangent[i] = (i < 3 ? options.pose_noise_m : options.pose_noise_rad) * rng.Normal();
  return T_map_camera * Pose3::Exp(tangent);
}

/// The whole keyframes of the query sessions that stand in the map; counts the others.
StatusOr<std::vector<Query>> ReadQueries(MapReader& reader, const MapRecord& map, const OverlapStudyOptions& options,
                                         OverlapStudy& study) {
  std::vector<Query> queries;
  for (const SessionId session : options.query_sessions) {
    MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, reader.ListFrames(map.id, session));
    for (const FrameRecord& frame : frames) {
      if (!frame.in_map) continue;
      if (frame.partial) {
        ++study.num_partial_skipped;
        continue;
      }
      MAPP_ASSIGN_OR_RETURN(const std::string packet, reader.GetPacket(frame.id));
      MAPP_ASSIGN_OR_RETURN(const Keyframe keyframe, DecodeKeyframe(packet));
      MAPP_ASSIGN_OR_RETURN(CameraRecord camera, reader.GetCamera(frame.camera));
      Query query{{map.id, frame.T_frame_camera, std::move(camera.camera), map.cone_range_m}, {}, {}};
      query.own = OwnPointsOf(keyframe, query.view.camera);
      if (query.own.p_camera.size() < options.min_own_points) {
        ++study.num_small_skipped;
        continue;
      }
      for (const size_t idx : query.own.feature_idx) {
        query.features.push_back({keyframe.features[idx].keypoint, keyframe.features[idx].descriptor});
      }
      queries.push_back(std::move(query));
    }
  }
  return queries;
}

/// The whole exchange of one query, as device and server have it.
StatusOr<Answered> Ask(TileCache& tiles, const MapView& view, const OwnPoints& own, SamplerKind sampler,
                       int num_samples) {
  ViewQuery query;
  query.pose_frame = PoseFrame::kMap;
  query.T_frame_camera = view.T_map_camera;
  query.sampler = sampler;
  query.sketch = MakeQuerySketch(sampler, view.camera, own.p_camera);
  const std::string query_bytes = EncodeViewQuery(query);
  MAPP_ASSIGN_OR_RETURN(const ViewQuery received, DecodeViewQuery(query_bytes));
  MapView asked = view;
  asked.T_map_camera = received.T_frame_camera;
  MAPP_ASSIGN_OR_RETURN(const OverlapAnswer assessed, AssessView(tiles, asked, received, num_samples));
  const OverlapQuestion question{view.camera, view.range_m, sampler, query.sketch, num_samples};
  const std::string answer_bytes = EncodeOverlapAnswer(assessed);
  MAPP_ASSIGN_OR_RETURN(const OverlapAnswer answer,
                        DecodeOverlapAnswer(answer_bytes, query, DrawSamples(question).p_camera.size()));
  return Answered{CountOverlap(question, answer, own.p_camera), query_bytes.size(), answer_bytes.size()};
}

std::optional<double> MatchedShare(const std::vector<JudgedView>& views, const std::vector<Truth>& truths) {
  BinaryScore score;
  for (size_t i = 0; i < views.size(); ++i) {
    for (size_t k = 0; k < views[i].redundant.size(); ++k) {
      score.Add(views[i].redundant[k], truths[i].by_descriptor[k]);
    }
  }
  return score.Precision();
}

std::optional<double> LocalisableShare(const std::vector<JudgedView>& views, const std::vector<Truth>& truths,
                                       const OverlapStudyOptions& options) {
  BinaryScore score;
  for (size_t i = 0; i < views.size(); ++i) {
    const auto num_matches = static_cast<size_t>(std::ranges::count(truths[i].by_descriptor, true));
    score.Add(views[i].overlap >= options.seen_overlap, num_matches >= options.enough_matches);
  }
  return score.Precision();
}

StatusOr<OverlapStudyRow> StudySampler(SamplerKind sampler, const OverlapStudyOptions& options, TileCache& tiles,
                                       const std::vector<Query>& queries, const std::vector<Truth>& truths) {
  OverlapStudyRow row;
  row.sampler = sampler;
  Rng rng(options.seed);  // every sampler is asked with the same poses
  std::vector<JudgedView> views;
  std::vector<double> query_bytes;
  std::vector<double> answer_bytes;
  for (size_t i = 0; i < queries.size(); ++i) {
    MapView asked = queries[i].view;
    asked.T_map_camera = Shaken(asked.T_map_camera, options, rng);
    MAPP_ASSIGN_OR_RETURN(Answered answered, Ask(tiles, asked, queries[i].own, sampler, options.num_samples));
    views.push_back({std::move(answered.count.redundant), truths[i].by_geometry, answered.count.overlap});
    query_bytes.push_back(static_cast<double>(answered.query_bytes));
    answer_bytes.push_back(static_cast<double>(answered.answer_bytes));
  }
  row.query_bytes = Summarize(query_bytes);
  row.answer_bytes = Summarize(answer_bytes);
  row.matched_of_known = MatchedShare(views, truths);
  row.localisable_of_seen = LocalisableShare(views, truths, options);
  MAPP_ASSIGN_OR_RETURN(row.by_geometry, ScoreOverlap(views, options.seen_overlap));
  for (size_t i = 0; i < views.size(); ++i) views[i].known = truths[i].by_descriptor;
  MAPP_ASSIGN_OR_RETURN(row.by_descriptor, ScoreOverlap(views, options.seen_overlap));
  return row;
}

std::vector<Truth> FindTruths(const OverlapOracle& oracle, const std::vector<Query>& queries) {
  std::vector<Truth> truths;
  for (const Query& query : queries) {
    truths.push_back({oracle.KnownByGeometry(query.view.T_map_camera, query.own.p_camera),
                      oracle.KnownByDescriptor(query.view.T_map_camera, query.view.camera, query.features)});
  }
  return truths;
}

void DescribeViews(const std::vector<Query>& queries, const std::vector<Truth>& truths, OverlapStudy& study) {
  std::vector<double> num_own_points;
  std::vector<JudgedView> by_oracle;
  for (size_t i = 0; i < queries.size(); ++i) {
    num_own_points.push_back(static_cast<double>(queries[i].features.size()));
    by_oracle.push_back({truths[i].by_geometry, truths[i].by_geometry, 0});
  }
  study.num_views = queries.size();
  study.mean_own_points = Mean(num_own_points).value_or(0);
  study.oracle_matched_of_known = MatchedShare(by_oracle, truths);
}

}  // namespace

StatusOr<OverlapStudy> RunOverlapStudy(const OverlapStudyOptions& options) {
  MAPP_RETURN_IF_ERROR(CheckOptions(options));
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapStore> store,
                        OpenSqliteMapStore(options.database_file, {.read_only = true}));
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store->Read());
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, reader->FindMap(options.map_name));
  MAPP_RETURN_IF_ERROR(CheckSessions(*reader, map, options));

  OverlapStudy study;
  MAPP_ASSIGN_OR_RETURN(const std::vector<Query> queries, ReadQueries(*reader, map, options, study));
  if (queries.empty()) {
    return absl::InvalidArgumentError(
        fmt::format("query_sessions: no whole keyframe with {} points in the map to ask with ({} partial ones, {} "
                    "with fewer points)",
                    options.min_own_points, study.num_partial_skipped, study.num_small_skipped));
  }
  const std::set<SessionId> asking(options.query_sessions.begin(), options.query_sessions.end());
  MAPP_ASSIGN_OR_RETURN(StudyMap content, LoadMapWithout(*store, map, asking));
  if (content.points.empty()) {
    return absl::InvalidArgumentError("query_sessions: no other session has brought a point to the map");
  }
  study.num_map_points = content.points.size();
  MAPP_ASSIGN_OR_RETURN(const auto oracle, OverlapOracle::Create(std::move(content.points), options.rule));
  const std::vector<Truth> truths = FindTruths(*oracle, queries);
  DescribeViews(queries, truths, study);
  for (const SamplerKind sampler : options.samplers) {
    MAPP_ASSIGN_OR_RETURN(OverlapStudyRow row, StudySampler(sampler, options, *content.tiles, queries, truths));
    study.rows.push_back(std::move(row));
  }
  return study;
}

}  // namespace mapp
