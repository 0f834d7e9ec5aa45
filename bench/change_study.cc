// Which changes of a simulated world does detection find in a map's history, and what does it miss and invent? Reads a
// database that `mapp replay` has filled with visits of the world; for setting thresholds.
//   change_study DATABASE MAP sim:garage:...,changes=10/0 FIRST_TRUTH.txt FIRST_TRAJECTORY.txt

#include "bench/value_or_exit.h"
#include "cli/visit_spec.h"
#include "datasets/sequence.h"
#include "eval/metrics/change_metrics.h"
#include "eval/metrics/trajectory_metrics.h"
#include "mapp/feature/feature.h"
#include "mapp/base/latency.h"
#include "server/changes/change_detector.h"
#include "sim/features/feature_camera.h"
#include "storage/sqlite/sqlite_map_store.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cstdlib>
#include <iostream>

namespace mapp {
namespace {

/// Features of each object that a visit sees, every so many poses.
std::map<uint32_t, size_t> CountSeen(const std::shared_ptr<const sim::FeatureWorld>& world, const sim::Visit& visit) {
  const auto camera = ValueOrExit(sim::FeatureCamera::Create(world, visit.rig, {}, 1));
  std::map<uint32_t, size_t> counts;
  for (size_t i = 0; i < visit.poses.size(); i += 10) {
    for (const auto& feature : camera->Observe(visit.poses[i].T_world_camera, visit.poses[i].stamp_ns)) {
      if (feature.depth_m > 0) ++counts[feature.object_id];
    }
  }
  return counts;
}

void Run(char** argv) {
  const auto store = ValueOrExit(OpenSqliteMapStore(argv[1], {.read_only = true}));
  const auto reader = ValueOrExit(store->Read());
  const MapRecord map = ValueOrExit(reader->FindMap(argv[2]));
  const VisitSpec spec = ValueOrExit(ParseVisitSpec(argv[3]));
  const auto simulation = ValueOrExit(sim::Simulate(spec.simulation));
  const auto world = std::make_shared<const sim::FeatureWorld>(simulation->world);
  const auto truth = ValueOrExit(ReadTumTrajectory(argv[4]));
  const auto trajectory = ValueOrExit(ReadTumTrajectory(argv[5]));
  const Sim3 T_truth_map = ValueOrExit(AbsoluteTrajectoryError(truth, trajectory, false)).T_truth_estimate;

  const Stopwatch stopwatch;
  const auto sessions = ValueOrExit(reader->ListSessions(map.id));
  std::vector<FrameRecord> frames;
  for (const FrameRecord& frame : ValueOrExit(reader->ListFrames(map.id, std::nullopt))) {
    if (frame.in_map) frames.push_back(frame);
  }
  FindingsMaker maker(*reader, map, sessions, frames, {});
  std::vector<SessionFindings> findings;
  size_t num_bytes = 0;
  for (const SessionRecord& session : sessions) {
    findings.push_back(ValueOrExit(maker.Make(CallContext::WithTimeout(std::chrono::hours(1)), session.id)));
    num_bytes += EncodeFindings(findings.back()).size();
    size_t num_missed = 0;
    for (const PointFinding& finding : findings.back().own) num_missed += finding.num_missed > 4 * finding.num_seen;
    fmt::print("session {}: {} frames, {} points judged, {} missed, {} earlier sessions\n", session.id.value(),
               findings.back().frames.size(), findings.back().own.size(), num_missed, findings.back().earlier.size());
  }
  const double finding_s = std::chrono::duration<double>(stopwatch.Elapsed()).count();
  const auto changes = ValueOrExit(DeriveChanges(*reader, map.id, sessions, frames, findings, maker, {}));
  fmt::print("{:.1f} s for findings ({} KB), {:.1f} s for changes; {} points\n", finding_s, num_bytes / 1000,
             std::chrono::duration<double>(stopwatch.Elapsed()).count() - finding_s, map.num_points);

  std::vector<std::map<uint32_t, size_t>> seen;
  for (const sim::Visit& visit : simulation->visits) seen.push_back(CountSeen(world, visit));
  std::vector<sim::WorldChange> fair;
  const auto kind_name = [](sim::ChangeKind kind) {
    return kind == sim::ChangeKind::kAppeared ? "appeared" : kind == sim::ChangeKind::kVanished ? "vanished" : "moved";
  };
  for (const sim::WorldChange& change : sim::ChangesOf(*simulation->world)) {
    size_t before = 0, after = 0;
    std::string visits;
    for (size_t i = 0; i < seen.size(); ++i) {
      const bool is_after = simulation->visits[i].poses.front().stamp_ns > change.stamp_ns;
      (is_after ? after : before) += seen[i][change.object_id];
      visits += fmt::format(" {}{}", is_after ? "|" : "", seen[i][change.object_id]);
    }
    const bool is_fair = (change.kind == sim::ChangeKind::kAppeared || before > 50) &&
                         (change.kind == sim::ChangeKind::kVanished || after > 50);
    if (is_fair) fair.push_back(change);
    const auto at = change.T_world_object_before ? change.T_world_object_before : change.T_world_object_after;
    fmt::print("{} object {} {} at {:.1f} {:.1f}:{}\n", is_fair ? "true" : "(unseen)", change.object_id,
               kind_name(change.kind), at->translation().x(), at->translation().y(), visits);
  }
  const auto true_changes = ValueOrExit(TrueChangesOf(*simulation->world, fair));
  if (std::getenv("DEBUG_POINTS")) {
    for (const auto& change : true_changes) {
      for (const bool is_after : {false, true}) {
        const auto& world_box = is_after ? change.after : change.before;
        if (!world_box) continue;
        const OrientedBox box{T_truth_map.pose.Inverse() * world_box->T_frame_box, world_box->size_m};
        std::vector<PointRecord> in;
        for (const TileRecord& tile : ValueOrExit(reader->ListTiles(map.id, std::nullopt))) {
          for (const PointRecord& point : ValueOrExit(reader->PointsInTile(map.id, tile.key))) {
            if (box.Contains(point.position, 0.1)) in.push_back(point);
          }
        }
        fmt::print("{} box at {:.1f} {:.1f}: {} points\n", is_after ? "after" : "before", world_box->T_frame_box.translation().x(), world_box->T_frame_box.translation().y(), in.size());
        Aabb b;
        for (auto& p : in) b.extend(p.position);
        for (const SessionFindings& f : findings) {
          std::array<size_t, 4> c{};
          for (const auto& p : in) {
            const PointFinding* q = nullptr;
            const auto own = std::ranges::lower_bound(f.own, p.id, {}, &PointFinding::point);
            if (own != f.own.end() && own->point == p.id) q = &*own;
            if (!q) { ++c[3]; continue; }
            ++c[q->num_missed > 4 * q->num_seen ? 1 : q->num_seen > q->num_missed ? 0 : 2];
          }
          fmt::print("  F{}: seen {} missed {} mixed {} none {}\n", f.session.value(), c[0], c[1], c[2], c[3]);
        }
        for (const auto& session : sessions) {
          std::array<size_t, 10> c{};
          std::array<std::array<size_t,4>,10> by_z{};
          const auto views = ValueOrExit(maker.ViewsInto(session.id, b, 100));
          for (const auto& view : views) {
            for (const auto& p : in) {
              const Eigen::Vector3d pc = view->T_map_camera.Inverse() * p.position;
              if (pc.z() <= 0 || !view->camera.Contains(view->camera.Undistorted().Project(pc), 16)) continue;
              ++c[0];
              if (pc.z() > view->range_m) { ++c[1]; continue; }
              if (pc.z() > view->geometry.farthest_depth_m()) { ++c[2]; continue; }
              if ((p.position - view->T_map_camera.translation()).normalized().dot(p.view_direction.cast<double>()) < .64) { ++c[3]; continue; }
              const float farthest = ReferenceFor(view->camera.MeanFocalPx(), p.reference_distance_m);
              if (pc.norm() > 1.2 * farthest) { ++c[4]; continue; }
              if (pc.norm() < farthest / 3.583) { ++c[5]; continue; }
              ++by_z[std::min(9, int(pc.z()))][size_t(view->geometry.At(pc.cast<float>()))];
              switch (view->geometry.At(pc.cast<float>())) { case SurfaceSighting::kUnknown: ++c[6]; break; case SurfaceSighting::kSeen: ++c[7]; break; case SurfaceSighting::kMissed: ++c[8]; break; case SurfaceSighting::kEmpty: ++c[9]; break; }
            }
          }
          for (size_t z=0; z<10; ++z) fmt::print("      z{}: {}\n", z, fmt::join(by_z[z], " "));
          fmt::print("   {}: views {} in image {} | range {} deeper {} unlike {} far {} near {} | unknown {} seen {} missed {} empty {}\n", session.id.value(), views.size(), c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8], c[9]);
        }
      }
    }
  }
  std::vector<DetectedChange> detections;
  const Pose3 T_world_map = T_truth_map.pose;
  for (const ChangeRecord& change : changes) {
    DetectedChange detected;
    detected.kind = change.kind == ChangeKind::kAppeared   ? sim::ChangeKind::kAppeared
                    : change.kind == ChangeKind::kVanished ? sim::ChangeKind::kVanished
                                                           : sim::ChangeKind::kMoved;
    const auto in_world = [&](const OrientedBox& box) {
      return OrientedBox{T_world_map * box.T_frame_box, box.size_m};
    };
    if (change.box_before) detected.before = in_world(*change.box_before);
    if (change.box_after) detected.after = in_world(*change.box_after);
    detections.push_back(detected);
    const OrientedBox& box = detected.before ? *detected.before : *detected.after;
    double best_iou = 0;
    uint32_t best = 0;
    for (size_t i = 0; i < true_changes.size(); ++i) {
      for (const auto& there : {true_changes[i].before, true_changes[i].after}) {
        if (!there) continue;
        const double iou = IntersectionOverUnion(*there, box);
        if (iou > best_iou) best_iou = iou, best = fair[i].object_id;
      }
    }
    if (std::getenv("DEBUG_DUMP")) {
      auto ids = change.points_before;
      ids.insert(ids.end(), change.points_after.begin(), change.points_after.end());
      std::ranges::sort(ids);
      for (const PointRecord& p : ValueOrExit(reader->FindPoints(ids))) {
        const Eigen::Vector3d w = T_world_map * p.position, d = T_world_map.rotation() * p.view_direction.cast<double>();
        fmt::print("P {} {:.3f} {:.3f} {:.3f} {:.2f} {:.2f} {:.2f}\n", detections.size(), w.x(), w.y(), w.z(), d.x(), d.y(), d.z());
      }
    }
    fmt::print(
        "found {} at {:.1f} {:.1f} {:.1f}, size {:.1f} {:.1f} {:.1f}, {} points, confidence {:.2f}, {} sessions "
        "{}..{}, IoU {:.2f} with {}\n",
        kind_name(detected.kind), box.T_frame_box.translation().x(), box.T_frame_box.translation().y(),
        box.T_frame_box.translation().z(), box.size_m.x(), box.size_m.y(), box.size_m.z(),
        change.points_before.size() + change.points_after.size(), change.confidence, change.sessions.size(),
        change.sessions.front().value(), change.sessions.back().value(), best_iou, best);
  }
  const ChangeScore score = ValueOrExit(ScoreChanges(true_changes, detections));
  fmt::print("true {} found {}; detected {} right {}; false {} duplicate {} wrong kind {}\n", score.all.num_true,
             score.all.num_found, score.all.num_detected, score.all.num_right, score.num_false, score.num_duplicate,
             score.num_wrong_kind);
}

}  // namespace
}  // namespace mapp

int main(int argc, char** argv) {
  if (argc != 6) {
    std::cerr << "usage: change_study DATABASE MAP SPEC FIRST_TRUTH FIRST_TRAJECTORY\n";
    return EXIT_FAILURE;
  }
  mapp::Run(argv);
}
