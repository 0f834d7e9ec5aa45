#include "cli/maps_bundle.h"

#include "bundle/bundle_check.h"
#include "bundle/bundle_file.h"
#include "cli/admin_client.h"
#include "cli/progress_bar.h"
#include "cli/text_table.h"
#include "storage/sqlite/staged_file.h"
#include "text/json_writer.h"

#include <fmt/format.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>

namespace mapp {
namespace {

namespace fs = std::filesystem;
using sqlite::StagedFile;

size_t Percent(uint64_t done, uint64_t total) { return total == 0 ? 0 : 100 * done / total; }

/// Reads all of it.
StatusOr<BundleSummary> Check(BundleFile& file, const std::stop_token& stop) {
  CallContext context;
  context.is_cancelled = [stop] { return stop.stop_requested(); };
  ProgressBar bar("check, %", 100);
  MAPP_ASSIGN_OR_RETURN(ByteSource source, file.Read());
  return CheckBundle(context, std::move(source), [&](uint64_t bytes_done) {
    bar.Update(Percent(bytes_done, file.num_bytes()), FormatBytes(static_cast<double>(bytes_done)));
  });
}

Status Explain(const Status& status, const std::stop_token& stop, const char* interrupted) {
  return absl::IsCancelled(status) && stop.stop_requested() ? absl::CancelledError(interrupted) : status;
}

Status RefuseExisting(const std::string& file) {
  std::error_code error;
  if (!fs::exists(fs::symlink_status(file, error))) return absl::OkStatus();
  return absl::AlreadyExistsError(fmt::format("{} is there already: choose another name, or --force", file));
}

/// Writes what the server sends to the staged file.
Status Receive(const MapsExportOptions& options, const StagedFile& staged, const std::stop_token& stop) {
  std::ofstream file(staged.path(), std::ios::binary | std::ios::trunc);
  const auto failed = [&] {
    const auto code = errno == ENOSPC ? absl::StatusCode::kResourceExhausted : absl::StatusCode::kFailedPrecondition;
    return Status(code, fmt::format("{}: {}", options.bundle, std::strerror(errno)));
  };
  const auto append = [&](std::string_view bytes) -> Status {
    file.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    return file ? absl::OkStatus() : failed();
  };
  ProgressBar bar(fmt::format("export {}, %", options.name), 100);
  const auto show = [&bar](const BundleExportStep& step) {
    bar.Update(Percent(step.frames_done, step.frames_total), FormatBytes(static_cast<double>(step.num_bytes)));
  };
  MAPP_RETURN_IF_ERROR(AdminClient(options.server).ExportBundle(options.name, options.at, append, show, stop));
  file.close();
  return file ? absl::OkStatus() : failed();
}

StatusOr<BundleSummary> Export(const MapsExportOptions& options, const std::stop_token& stop) {
  if (!options.force) MAPP_RETURN_IF_ERROR(RefuseExisting(options.bundle));
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<StagedFile> staged, StagedFile::Create(options.bundle));
  MAPP_RETURN_IF_ERROR(Receive(options, *staged, stop));
  MAPP_ASSIGN_OR_RETURN(BundleFile file, BundleFile::Open(staged->path()));
  StatusOr<BundleSummary> summary = Check(file, stop);
  if (!summary.ok()) return summary;
  MAPP_RETURN_IF_ERROR(staged->Commit(options.force ? StagedFile::Existing::kReplace : StagedFile::Existing::kRefuse));
  return summary;
}

void AppendContents(const BundleSummary& summary, JsonWriter& json) {
  json.Field("source_name", summary.map.map.name).Field("source_revision", summary.map.map.revision.value());
  json.Field("exported_unix_ns", summary.map.exported_ns).Field("num_sessions", summary.counts.sessions);
  json.Field("num_frames", summary.counts.frames).Field("num_points", summary.counts.points);
  json.Field("num_bytes", summary.num_bytes);
}

std::string DescribeContents(const BundleSummary& summary) {
  return fmt::format("{} at revision {}, exported {} UTC: {} sessions, {} frames, {} points, {}", summary.map.map.name,
                     summary.map.map.revision.value(), FormatUnixTime(summary.map.exported_ns), summary.counts.sessions,
                     summary.counts.frames, summary.counts.points, FormatBytes(static_cast<double>(summary.num_bytes)));
}

Status Send(const MapsImportOptions& options, const std::string& name, BundleFile& file, const std::stop_token& stop) {
  MAPP_ASSIGN_OR_RETURN(const ByteSource source, file.Read());
  ProgressBar bar(fmt::format("import {}, %", name), 100);
  const auto show = [&bar](const BundleImportStep& step) {
    constexpr const char* kPhases[] = {"sending", "the server checks", "the server writes"};
    bar.Update(Percent(step.bytes_done, step.bytes_total), kPhases[static_cast<size_t>(step.phase)]);
  };
  return AdminClient(options.server).ImportBundle(name, source, file.num_bytes(), show, stop).status();
}

}  // namespace

Status RunMapsExport(const MapsExportOptions& options, const std::stop_token& stop, std::ostream& out) {
  const StatusOr<BundleSummary> exported = Export(options, stop);
  MAPP_RETURN_IF_ERROR(Explain(exported.status(), stop, "interrupted: nothing was exported"));
  if (options.json) {
    JsonWriter json;
    json.BeginObject().Field("bundle", options.bundle);
    AppendContents(*exported, json);
    json.EndObject();
    out << std::move(json).Finish();
  } else {
    out << fmt::format("{}: {}\n", options.bundle, DescribeContents(*exported));
  }
  return absl::OkStatus();
}

Status RunMapsImport(const MapsImportOptions& options, const std::stop_token& stop, std::ostream& out) {
  constexpr char kInterrupted[] = "interrupted: nothing was imported";
  MAPP_ASSIGN_OR_RETURN(BundleFile file, BundleFile::Open(options.bundle));
  const StatusOr<BundleSummary> summary = Check(file, stop);
  MAPP_RETURN_IF_ERROR(Explain(Annotate(summary.status(), options.bundle), stop, kInterrupted));
  const std::string& name = options.as.empty() ? summary->map.map.name : options.as;
  if (!options.dry_run) MAPP_RETURN_IF_ERROR(Explain(Send(options, name, file, stop), stop, kInterrupted));
  if (options.json) {
    JsonWriter json;
    json.BeginObject().Field("name", name).Field("imported", !options.dry_run).Field("bundle", options.bundle);
    AppendContents(*summary, json);
    json.EndObject();
    out << std::move(json).Finish();
  } else {
    out << fmt::format("{} {} from {}: {}\n", options.dry_run ? "would import" : "imported", name, options.bundle,
                       DescribeContents(*summary));
  }
  return absl::OkStatus();
}

}  // namespace mapp
