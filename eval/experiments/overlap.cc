// The study behind DESIGN 5, on the real system: which estimator tells best what the map holds.

#include "eval/experiments/experiment.h"
#include "eval/experiments/scenarios.h"
#include "eval/harness/choices.h"
#include "eval/overlap_study.h"
#include "storage/sqlite/sqlite_map_store.h"

#include <fmt/format.h>

namespace mapp {
namespace {

/// The second half of the map's sessions, whose keyframes are asked about; the map is what the first half brought.
StatusOr<std::vector<SessionId>> QuerySessions(const std::string& database) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapStore> store, OpenSqliteMapStore(database, {.read_only = true}));
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store->Read());
  MAPP_ASSIGN_OR_RETURN(const std::vector<SessionRecord> sessions, reader->ListSessions(std::nullopt));
  std::vector<SessionId> queries;
  for (size_t i = (sessions.size() + 1) / 2; i < sessions.size(); ++i) queries.push_back(sessions[i].id);
  return queries;
}

struct Tables {
  ResultTable geometry;
  ResultTable descriptors;
};

Tables EmptyTables() {
  Tables tables;
  tables.geometry.id = "overlap_geometry";
  tables.geometry.title = "Against what the map holds by geometry";
  tables.geometry.columns = {{"setting"}, {"strategy"},    {"F1 of seen", 2}, {"lost", 2},   {"resent", 2},
                             {"bias", 3}, {"RMSE", 3},     {"precision", 2},  {"recall", 2}, {"mean overlap", 2},
                             {"true", 2}, {"query, B", 0}, {"answer, B", 0},  {"views", 0}};
  tables.descriptors.id = "overlap_descriptors";
  tables.descriptors.title = "Against what could be matched by its looks";
  tables.descriptors.columns = {{"setting"},
                                {"strategy"},
                                {"F1 of seen", 2},
                                {"lost", 2},
                                {"resent", 2},
                                {"known points with a matching descriptor", 2},
                                {"seen views with 75 matches", 2}};
  return tables;
}

void AddStudyRows(const std::string& setting, const OverlapStudy& study, Tables& tables) {
  for (const OverlapStudyRow& row : study.rows) {
    const OverlapScore& g = row.by_geometry;
    tables.geometry.rows.push_back({setting, NameOf(kSamplerChoices, row.sampler), Cell(g.seen.F1()), Cell(g.Lost()),
                                    Cell(g.Resent()), g.bias, g.rmse, Cell(g.points.Precision()),
                                    Cell(g.points.Recall()), g.mean_overlap, g.mean_true_overlap, row.query_bytes.mean,
                                    row.answer_bytes.mean, static_cast<double>(study.num_views)});
    const OverlapScore& d = row.by_descriptor;
    tables.descriptors.rows.push_back({setting, NameOf(kSamplerChoices, row.sampler), Cell(d.seen.F1()), Cell(d.Lost()),
                                       Cell(d.Resent()), Cell(row.matched_of_known), Cell(row.localisable_of_seen)});
  }
  tables.descriptors.rows.push_back(
      {setting, "(the geometric oracle)", Cell(), Cell(), Cell(), Cell(study.oracle_matched_of_known), Cell()});
}

}  // namespace

StatusOr<ExperimentResult> RunOverlap(EvalContext& context) {
  ExperimentResult result;
  Tables tables = EmptyTables();
  for (const std::string& setting : context.Chosen({"garage", "plaza", "hall"})) {
    const bool hall = setting == "hall";
    const FleetSpec spec = FleetOf(hall ? HallWorld(context) : SettingWorld(context, setting),
                                   hall ? Level::kRendered : Level::kFeatures, "upload_all");
    MAPP_ASSIGN_OR_RETURN(const auto fleet, context.lab.Run(spec));
    OverlapStudyOptions options;
    options.database_file = fleet->database;
    options.map_name = kEvalMapName;
    MAPP_ASSIGN_OR_RETURN(options.query_sessions, QuerySessions(fleet->database));
    options.samplers = {SamplerKind::kUniform, SamplerKind::kDepthSketch, SamplerKind::kOccupancy};
    StatusOr<OverlapStudy> study = RunOverlapStudy(options);
    if (!study.ok()) return Annotate(study.status(), setting);
    AddStudyRows(setting, *study, tables);
    result.setup += Describe(spec) + " ";
  }
  result.setup += "Whole keyframes of the second half of the users are asked about on the map of the first half.";
  result.tables = {std::move(tables.geometry), std::move(tables.descriptors)};
  result.paper = "The paper samples the view cone evenly (\"uniform\") and reports no comparison.";
  result.remarks = {
      "Lost: share of the fresh points that would be dropped. Resent: share of the redundant ones that would "
      "be sent all the same. Bias and RMSE are of the overlap.",
      "The oracle calls a point known when the map has one within max(5 cm, 5 % of its depth) that was seen "
      "from within 50 degrees of the query's ray."};
  return result;
}

}  // namespace mapp
