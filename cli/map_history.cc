#include "cli/map_history.h"

#include "cli/admin_client.h"
#include "cli/confirm.h"
#include "cli/text_table.h"
#include "text/json_writer.h"

#include <fmt/format.h>

#include <algorithm>

namespace mapp {
namespace {

std::string FormatRange(uint64_t first, uint64_t last) {
  return first == last ? std::to_string(first) : fmt::format("{}..{}", first, last);
}

/// Tags of the revisions in [first, last], as `name` or, inside of a range, `name@revision`.
std::string TagsWithin(const std::vector<TagSummary>& tags, uint64_t first, uint64_t last) {
  std::string names;
  for (const TagSummary& tag : tags) {
    if (tag.revision < first || tag.revision > last) continue;
    if (!names.empty()) names += ' ';
    names += first == last ? tag.name : fmt::format("{}@{}", tag.name, tag.revision);
  }
  return names;
}

std::string FormatSession(uint64_t session_id, const std::string& device) {
  return session_id == 0 ? "" : fmt::format("{} {}", session_id, device);
}

std::string FormatText(const RevisionLogSummary& log) {
  TextTable table({{"revisions"}, {"until (UTC)"}, {"cause"}, {"count", Align::kRight}, {"session"}, {"tags"}});
  for (const RevisionRunSummary& run : log.runs) {
    table.AddRow({FormatRange(run.first, run.last), FormatUnixTime(run.last_unix_ns), run.cause,
                  std::to_string(run.num_revisions), FormatSession(run.session_id, run.device),
                  TagsWithin(log.tags, run.first, run.last)});
  }
  std::string text = table.Format();
  if (log.truncated) text += "older ones: see --limit\n";
  if (log.oldest_revision > 0) text += fmt::format("compacted: the oldest to be read is {}\n", log.oldest_revision);
  return text;
}

void AppendTags(const std::vector<TagSummary>& tags, JsonWriter& json) {
  json.Key("tags").BeginArray();
  for (const TagSummary& tag : tags) {
    json.BeginObject().Field("name", tag.name).Field("revision", tag.revision);
    json.Field("created_unix_ns", tag.created_unix_ns).EndObject();
  }
  json.EndArray();
}

std::string FormatJson(const std::string& name, const RevisionLogSummary& log) {
  JsonWriter json;
  json.BeginObject().Field("map", name).Field("oldest_revision", log.oldest_revision);
  json.Field("truncated", log.truncated).Key("runs").BeginArray();
  for (const RevisionRunSummary& run : log.runs) {
    json.BeginObject().Field("first_revision", run.first).Field("last_revision", run.last);
    json.Field("num_revisions", run.num_revisions).Field("first_unix_ns", run.first_unix_ns);
    json.Field("last_unix_ns", run.last_unix_ns).Field("cause", run.cause);
    json.Field("session_id", run.session_id).Field("device", run.device).EndObject();
  }
  json.EndArray();
  AppendTags(log.tags, json);
  json.EndObject();
  return std::move(json).Finish();
}

std::string FormatText(const std::string& name, const MapDiffSummary& diff) {
  std::string text = fmt::format("{}: revision {} -> {}\n", name, diff.from, diff.to);
  if (diff.sessions.empty()) return text + "no difference\n";
  TextTable table({{"session"},
                   {"frames +", Align::kRight},
                   {"moved", Align::kRight},
                   {"-", Align::kRight},
                   {"points +", Align::kRight},
                   {"moved", Align::kRight},
                   {"-", Align::kRight}});
  for (const SessionDiffSummary& session : diff.sessions) {
    table.AddRow({FormatSession(session.session_id, session.device), std::to_string(session.frames_added),
                  std::to_string(session.frames_moved), std::to_string(session.frames_removed),
                  std::to_string(session.points_added), std::to_string(session.points_moved),
                  std::to_string(session.points_removed)});
  }
  return text + table.Format();
}

std::string FormatJson(const std::string& name, const MapDiffSummary& diff) {
  JsonWriter json;
  json.BeginObject().Field("map", name).Field("from_revision", diff.from).Field("to_revision", diff.to);
  json.Key("sessions").BeginArray();
  for (const SessionDiffSummary& session : diff.sessions) {
    json.BeginObject().Field("session_id", session.session_id).Field("device", session.device);
    json.Field("frames_added", session.frames_added).Field("frames_moved", session.frames_moved);
    json.Field("frames_removed", session.frames_removed).Field("points_added", session.points_added);
    json.Field("points_moved", session.points_moved).Field("points_removed", session.points_removed).EndObject();
  }
  json.EndArray().EndObject();
  return std::move(json).Finish();
}

Status ListTags(const MapsTagOptions& options, std::ostream& out) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<TagSummary> tags, AdminClient(options.server).ListTags(options.name));
  if (options.json) {
    JsonWriter json;
    json.BeginObject().Field("map", options.name);
    AppendTags(tags, json);
    json.EndObject();
    out << std::move(json).Finish();
    return absl::OkStatus();
  }
  TextTable table({{"tag"}, {"revision", Align::kRight}, {"given (UTC)"}});
  for (const TagSummary& tag : tags) {
    table.AddRow({tag.name, std::to_string(tag.revision), FormatUnixTime(tag.created_unix_ns)});
  }
  out << table.Format();
  return absl::OkStatus();
}

Status ConfirmRemoval(const MapsTagOptions& options, AdminClient& client, std::istream& in, std::ostream& out) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<TagSummary> tags, client.ListTags(options.name));
  const auto tag = std::ranges::find(tags, options.tag, &TagSummary::name);
  if (tag == tags.end()) {
    return absl::NotFoundError(fmt::format("map \"{}\" has no tag \"{}\"", options.name, options.tag));
  }
  const Question question{.text = fmt::format("Remove tag {} of revision {}? mapp compact may drop that revision then.",
                                              tag->name, tag->revision),
                          .doing = "removing a tag",
                          .not_done = "no tag was removed",
                          .yes = options.yes,
                          .interactive = options.interactive};
  return Confirm(question, in, out);
}

}  // namespace

Status RunMapsLog(const MapsLogOptions& options, std::ostream& out) {
  MAPP_ASSIGN_OR_RETURN(const RevisionLogSummary log,
                        AdminClient(options.server).ListRevisions(options.name, options.max_runs));
  out << (options.json ? FormatJson(options.name, log) : FormatText(log));
  return absl::OkStatus();
}

Status RunMapsDiff(const MapsDiffOptions& options, std::ostream& out) {
  MAPP_ASSIGN_OR_RETURN(const MapDiffSummary diff,
                        AdminClient(options.server).DiffRevisions(options.name, options.from, options.to));
  out << (options.json ? FormatJson(options.name, diff) : FormatText(options.name, diff));
  return absl::OkStatus();
}

Status RunMapsTag(const MapsTagOptions& options, std::istream& in, std::ostream& out) {
  if (options.tag.empty()) return ListTags(options, out);
  AdminClient client(options.server);
  uint64_t revision = 0;
  if (options.remove) {
    MAPP_RETURN_IF_ERROR(ConfirmRemoval(options, client, in, out));
    MAPP_RETURN_IF_ERROR(client.DeleteTag(options.name, options.tag));
  } else {
    MAPP_ASSIGN_OR_RETURN(revision, client.PutTag(options.name, options.tag, options.at));
  }
  if (options.json) {
    JsonWriter json;
    json.BeginObject().Field("map", options.name).Field("tag", options.tag).Field("removed", options.remove);
    if (!options.remove) json.Field("revision", revision);
    json.EndObject();
    out << std::move(json).Finish();
  } else if (options.remove) {
    out << fmt::format("{}: tag {} removed\n", options.name, options.tag);
  } else {
    out << fmt::format("{}: {} is revision {}\n", options.name, options.tag, revision);
  }
  return absl::OkStatus();
}

}  // namespace mapp
