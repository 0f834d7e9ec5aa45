#include "storage/sqlite/database_file.h"
#include "storage/sqlite/interrupter.h"
#include "storage/sqlite/verify_check.h"
#include "storage/verify.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <memory>
#include <utility>

namespace mapp {
namespace sqlite {
namespace {

/// What a check has found, or an earlier one of the same name.
class Findings {
 public:
  Findings(VerifyReport& report, int max_listed) : report_(report), max_listed_(max_listed) {}

  void Add(const std::string& check, const std::string& what, std::optional<int64_t> id, std::string message) {
    if (check != check_) {
      check_ = check;
      num_listed_ = 0;
    }
    if (num_listed_ < max_listed_) {
      ++num_listed_;
      report_.violations.push_back({check, what, id, std::move(message)});
      return;
    }
    if (report_.unlisted.empty() || report_.unlisted.back().check != check) report_.unlisted.push_back({check, 0});
    ++report_.unlisted.back().count;
  }

 private:
  VerifyReport& report_;
  const int max_listed_;
  std::string check_;
  int num_listed_ = 0;
};

std::vector<VerifyCheck> AllChecks(const VerifyOptions& options) {
  std::vector<VerifyCheck> checks = FileChecks();
  for (auto& more : {CatalogChecks(options), FrameChecks(), PointChecks(), TileChecks(), ChangeChecks()}) {
    checks.insert(checks.end(), more.begin(), more.end());
  }
  return checks;
}

Status RunCheck(Connection& db, const VerifyCheck& check, Findings& findings) {
  Statement rows = db.Prepare(check.sql);
  for (;;) {
    MAPP_ASSIGN_OR_RETURN(const bool has_row, rows.Step());
    if (!has_row) return absl::OkStatus();
    std::string found;
    if (check.fault) {
      MAPP_ASSIGN_OR_RETURN(found, check.fault(db, rows));
    } else {
      found = rows.Bytes(1);
    }
    const std::optional<int64_t> id = rows.IsNull(0) ? std::nullopt : std::optional(rows.Int64(0));
    for (size_t begin = 0; begin < found.size();) {
      const size_t end = std::min(found.find('\n', begin), found.size());
      if (end > begin) findings.Add(check.name, check.what, id, found.substr(begin, end - begin));
      begin = end + 1;
    }
  }
}

StatusOr<VerifyReport> Verify(const CallContext& context, const std::string& database, const VerifyOptions& options) {
  MAPP_ASSIGN_OR_RETURN(const std::string file, ResolveFile(database, /*must_exist=*/true));
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<Connection> db, OpenForReading(file, {.read_only = true}));
  MAPP_RETURN_IF_ERROR(CheckSchemaIsCurrent(*db));
  MAPP_ASSIGN_OR_RETURN(const auto snapshot, Transaction::Begin(*db, Transaction::Kind::kSnapshot));
  const Interrupter interrupter(context, *db);
  VerifyReport report;
  Findings findings(report, options.max_listed);
  const std::vector<VerifyCheck> checks = AllChecks(options);
  report.num_checks = static_cast<int>(checks.size());
  // Apart from the findings of the checks, which a check of the same name may go on adding to.
  std::vector<Violation> unfinished;
  const auto note = [&](const std::string& check, const Status& status) -> Status {
    // An interrupted statement fails, too.
    MAPP_RETURN_IF_ERROR(context.Check());
    if (!status.ok()) {
      unfinished.push_back({"sqlite", "check", std::nullopt,
                            fmt::format("{} did not get to its end: {}", check, std::string(status.message()))});
    }
    return absl::OkStatus();
  };
  for (size_t i = 0; i < checks.size(); ++i) {
    MAPP_RETURN_IF_ERROR(context.Check());
    if (options.on_progress) options.on_progress({checks[i].name, static_cast<int>(i), report.num_checks});
    MAPP_RETURN_IF_ERROR(note(checks[i].name, RunCheck(*db, checks[i], findings)));
  }
  const std::pair<const char*, int64_t*> counts[] = {{"SELECT count(*) FROM maps", &report.num_maps},
                                                     {"SELECT count(*) FROM frames", &report.num_keyframes},
                                                     {"SELECT count(*) FROM points", &report.num_points}};
  for (const auto& [sql, count] : counts) {
    const StatusOr<int64_t> counted = db->QueryInt64(sql);
    MAPP_RETURN_IF_ERROR(note("counting", counted.status()));
    *count = counted.value_or(0);
  }
  report.violations.insert(report.violations.begin(), std::make_move_iterator(unfinished.begin()),
                           std::make_move_iterator(unfinished.end()));
  return report;
}

}  // namespace
}  // namespace sqlite

int64_t VerifyReport::num_violations() const {
  auto count = static_cast<int64_t>(violations.size());
  for (const UnlistedViolations& more : unlisted) count += more.count;
  return count;
}

StatusOr<VerifyReport> VerifyDatabase(const CallContext& context, const std::string& database,
                                      const VerifyOptions& options) {
  StatusOr<VerifyReport> report = sqlite::Verify(context, database, options);
  if (!report.ok()) return Annotate(report.status(), database);
  return report;
}

}  // namespace mapp
