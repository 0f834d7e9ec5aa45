#include "cli/backup.h"

#include "cli/admin_client.h"
#include "cli/confirm.h"
#include "cli/progress_bar.h"
#include "storage/sqlite/restore.h"
#include "text/json_writer.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

namespace mapp {
namespace {

CallContext UntilStopped(const std::stop_token& stop) {
  CallContext context;
  context.is_cancelled = [stop] { return stop.stop_requested(); };
  return context;
}

/// In a person's words when the person has stopped it.
Status Explain(const Status& status, const std::stop_token& stop, const char* interrupted) {
  return absl::IsCancelled(status) && stop.stop_requested() ? absl::CancelledError(interrupted) : status;
}

std::string Megabytes(int64_t num_bytes) { return fmt::format("{:.1f} MB", static_cast<double>(num_bytes) / 1e6); }

void ShowCopy(const BackupProgress& progress, ProgressBar& bar) {
  const int64_t total = std::max<int64_t>(progress.bytes_total, 1);
  bar.Update(static_cast<size_t>(100 * progress.bytes_done / total),
             progress.checking ? std::string("checking the copy") : Megabytes(progress.bytes_done));
}

StatusOr<Backup> MakeBackup(const BackupCommandOptions& options, const BackupObserver& show,
                            const std::stop_token& stop) {
  BackupOptions backup;
  backup.to = options.to;
  backup.num_kept = options.num_kept;
  backup.dry_run = options.dry_run;
  backup.on_progress = show;
  if (options.database.empty()) return AdminClient(options.server).BackUp(backup, stop);
  StatusOr<Backup> made = BackUpDatabase(UntilStopped(stop), options.database, backup);
  if (!made.ok()) return Annotate(made.status(), options.database);
  return made;
}

std::string FormatJson(const Backup& backup, bool dry_run) {
  JsonWriter json;
  json.BeginObject().Field("dry_run", dry_run).Field("file", backup.file).Field("num_bytes", backup.num_bytes);
  json.Field("schema_version", backup.schema_version).Key("deleted").BeginArray();
  for (const std::string& file : backup.deleted) json.Value(file);
  json.EndArray().EndObject();
  return std::move(json).Finish();
}

std::string FormatText(const Backup& backup, bool dry_run) {
  std::string text = fmt::format("{}{}: {}, schema {}\n", dry_run ? "would write " : "", backup.file,
                                 Megabytes(backup.num_bytes), backup.schema_version);
  for (const std::string& file : backup.deleted)
    text += fmt::format("{} {}\n", dry_run ? "would delete" : "deleted", file);
  return text;
}

std::string FormatJson(const RestorePlan& plan, bool restored) {
  JsonWriter json;
  json.BeginObject().Field("backup", plan.backup).Field("db", plan.database).Field("restored", restored);
  json.Field("num_bytes", plan.num_bytes).Field("schema_version", plan.schema_version);
  json.Field("num_maps", plan.num_maps).Field("num_keyframes", plan.num_keyframes).Key("kept_as");
  if (plan.replaced_bytes) {
    json.Value(plan.kept_as);
  } else {
    json.Null();
  }
  json.EndObject();
  return std::move(json).Finish();
}

std::string Describe(const RestorePlan& plan) {
  return fmt::format("{} maps, {} keyframes, {}, schema {}", plan.num_maps, plan.num_keyframes,
                     Megabytes(plan.num_bytes), plan.schema_version);
}

std::string FormatText(const RestorePlan& plan, bool restored) {
  const char* verb = restored ? "restored" : "would restore";
  std::string text = fmt::format("{} {} from {}: {}\n", verb, plan.database, plan.backup, Describe(plan));
  if (plan.replaced_bytes) {
    text += fmt::format("{} the old one, {}, as {}\n", restored ? "kept" : "would keep",
                        Megabytes(*plan.replaced_bytes), plan.kept_as);
  }
  return text;
}

Status ConfirmReplacing(const RestoreCommandOptions& options, const RestorePlan& plan, std::istream& in,
                        std::ostream& out) {
  if (!plan.replaced_bytes) return absl::OkStatus();
  const Question question{
      .text = fmt::format("Replace {} ({}) by {} ({})? The old one is kept as {}.", plan.database,
                          Megabytes(*plan.replaced_bytes), plan.backup, Describe(plan), plan.kept_as),
      .doing = "replacing a database",
      .not_done = "nothing was restored",
      .yes = options.yes,
      .interactive = options.interactive};
  return Confirm(question, in, out);
}

}  // namespace

Status RunBackup(const BackupCommandOptions& options, const std::stop_token& stop, std::ostream& out) {
  StatusOr<Backup> made = [&] {
    ProgressBar bar("backup, %", 100);
    const auto show = [&bar](const BackupProgress& progress) { ShowCopy(progress, bar); };
    return MakeBackup(options, show, stop);
  }();
  MAPP_RETURN_IF_ERROR(Explain(made.status(), stop, "interrupted: no backup was made"));
  out << (options.json ? FormatJson(*made, options.dry_run) : FormatText(*made, options.dry_run));
  return absl::OkStatus();
}

Status RunRestore(const RestoreCommandOptions& options, const std::stop_token& stop, std::istream& in,
                  std::ostream& out) {
  constexpr char kInterrupted[] = "interrupted: nothing was restored";
  const CallContext context = UntilStopped(stop);
  const auto plan = PlanRestore(context, options.backup, options.database, options.now);
  MAPP_RETURN_IF_ERROR(Explain(plan.status(), stop, kInterrupted));
  if (!options.dry_run) {
    MAPP_RETURN_IF_ERROR(ConfirmReplacing(options, *plan, in, out));
    ProgressBar bar("restore, %", 100);
    const auto show = [&bar](const RestoreProgress& progress) { ShowCopy(progress.copy, bar); };
    MAPP_RETURN_IF_ERROR(Explain(Restore(context, *plan, show), stop, kInterrupted));
  }
  const bool restored = !options.dry_run;
  out << (options.json ? FormatJson(*plan, restored) : FormatText(*plan, restored));
  return absl::OkStatus();
}

}  // namespace mapp
