#include "eval/harness/results.h"

#include "mapp/base/check.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

namespace mapp {
namespace {

using OrderedJson = nlohmann::ordered_json;

constexpr int kFormat = 1;

OrderedJson CellToJson(const Cell& cell) {
  if (cell.number) return *cell.number;
  if (!cell.text.empty()) return cell.text;
  return nullptr;
}

Cell CellFromJson(const OrderedJson& json) {
  if (json.is_number()) return json.get<double>();
  if (json.is_string()) return json.get<std::string>();
  return {};
}

OrderedJson ToJson(const ResultTable& table) {
  OrderedJson json = {{"id", table.id}, {"title", table.title}};
  for (const Column& column : table.columns) {
    json["columns"].push_back({{"name", column.name}, {"digits", column.digits}});
  }
  json["rows"] = OrderedJson::array();
  for (const auto& row : table.rows) {
    OrderedJson cells = OrderedJson::array();
    for (const Cell& cell : row) cells.push_back(CellToJson(cell));
    json["rows"].push_back(std::move(cells));
  }
  if (table.plot) {
    json["plot"] = {{"kind", table.plot->kind == Plot::Kind::kBars ? "bars" : "lines"},
                    {"x", table.plot->x},
                    {"y", table.plot->y},
                    {"y_label", table.plot->y_label}};
  }
  return json;
}

ResultTable TableFromJson(const OrderedJson& json) {
  ResultTable table{json.at("id"), json.at("title"), {}, {}, {}};
  for (const OrderedJson& column : json.at("columns"))
    table.columns.push_back({column.at("name"), column.at("digits")});
  for (const OrderedJson& row : json.at("rows")) {
    auto& cells = table.rows.emplace_back();
    for (const OrderedJson& cell : row) cells.push_back(CellFromJson(cell));
  }
  if (json.contains("plot")) {
    const OrderedJson& plot = json["plot"];
    table.plot = Plot{plot.at("kind") == "bars" ? Plot::Kind::kBars : Plot::Kind::kLines, plot.at("x"), plot.at("y"),
                      plot.at("y_label")};
  }
  return table;
}

OrderedJson ToJson(const ExperimentResult& result) {
  OrderedJson json = {{"name", result.name},   {"title", result.title},     {"setup", result.setup},
                      {"paper", result.paper}, {"remarks", result.remarks}, {"duration_s", result.duration_s}};
  json["tables"] = OrderedJson::array();
  for (const ResultTable& table : result.tables) json["tables"].push_back(ToJson(table));
  return json;
}

ExperimentResult ExperimentFromJson(const OrderedJson& json) {
  ExperimentResult result;
  result.name = json.at("name");
  result.title = json.at("title");
  result.setup = json.at("setup");
  result.paper = json.at("paper");
  result.remarks = json.at("remarks").get<std::vector<std::string>>();
  result.duration_s = json.at("duration_s");
  for (const OrderedJson& table : json.at("tables")) result.tables.push_back(TableFromJson(table));
  return result;
}

ResultSet SetFromJson(const OrderedJson& json) {
  ResultSet results;
  results.version = json.at("version");
  results.commit = json.at("commit");
  results.machine = json.at("machine");
  results.command = json.at("command");
  results.scale = json.at("scale");
  results.seed = json.at("seed");
  for (const OrderedJson& experiment : json.at("experiments"))
    results.experiments.push_back(ExperimentFromJson(experiment));
  return results;
}

std::string CellText(const Cell& cell, int digits) {
  if (cell.number) return fmt::format("{:.{}f}", *cell.number, digits);
  return cell.text.empty() ? "–" : cell.text;
}

std::string CsvField(const std::string& text) {
  if (text.find_first_of(",\"\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? std::string("\"\"") : std::string(1, c);
  return quoted + '"';
}

void AppendTable(const ResultTable& table, bool has_plots, std::string& text) {
  text += fmt::format("\n**{}**\n\n|", table.title);
  for (const Column& column : table.columns) text += fmt::format(" {} |", column.name);
  text += "\n|";
  for (size_t i = 0; i < table.columns.size(); ++i) text += "---|";
  for (const auto& row : table.rows) {
    text += "\n|";
    for (size_t i = 0; i < row.size(); ++i) text += fmt::format(" {} |", CellText(row[i], table.columns[i].digits));
  }
  text += "\n";
  if (has_plots && table.plot) text += fmt::format("\n![{}]({}.png)\n", table.title, table.id);
}

}  // namespace

void Merge(ExperimentResult result, ResultSet& results) {
  for (const ResultTable& table : result.tables) {
    for (const auto& row : table.rows) MAPP_CHECK(row.size() == table.columns.size());
  }
  const auto same = std::ranges::find(results.experiments, result.name, &ExperimentResult::name);
  if (same == results.experiments.end()) {
    results.experiments.push_back(std::move(result));
  } else {
    *same = std::move(result);
  }
}

std::string FormatResults(const ResultSet& results) {
  OrderedJson json = {{"format", kFormat},          {"version", results.version},         {"commit", results.commit},
                      {"machine", results.machine}, {"command", results.command},         {"scale", results.scale},
                      {"seed", results.seed},       {"experiments", OrderedJson::array()}};
  for (const ExperimentResult& result : results.experiments) json["experiments"].push_back(ToJson(result));
  return json.dump(2) + "\n";
}

StatusOr<ResultSet> ParseResults(const std::string& text, const std::string& file) {
  const OrderedJson json = OrderedJson::parse(text, /*cb=*/nullptr, /*allow_exceptions=*/false);
  if (!json.is_object() || !json.contains("format") || !json["format"].is_number_integer()) {
    return absl::DataLossError(fmt::format("{}: not a results file of mapp eval", file));
  }
  if (json["format"] != kFormat) {
    return absl::FailedPreconditionError(fmt::format("{}: results of format {}, this program reads format {}", file,
                                                     json["format"].get<int64_t>(), kFormat));
  }
  try {
    return SetFromJson(json);
  } catch (const OrderedJson::exception& exception) {  // a field is missing or of another type
    return absl::DataLossError(fmt::format("{}: {}", file, exception.what()));
  }
}

std::string FormatCsv(const ResultTable& table) {
  std::string text;
  const auto append = [&](size_t i, const std::string& field) { text += (i == 0 ? "" : ",") + CsvField(field); };
  for (size_t i = 0; i < table.columns.size(); ++i) append(i, table.columns[i].name);
  text += "\n";
  for (const auto& row : table.rows) {
    for (size_t i = 0; i < row.size(); ++i) {
      append(i, row[i].number ? fmt::format("{}", *row[i].number) : row[i].text);
    }
    text += "\n";
  }
  return text;
}

std::string FormatReport(const ResultSet& results, bool has_plots) {
  std::string text = "# Evaluation\n\n";
  text += fmt::format(
      "`{}` ({} scale, seed {}), Map++ {} at commit {}, on {}. Every figure can be made again with that "
      "command; `results.json` and the CSV files hold them in full.\n",
      results.command, results.scale, results.seed, results.version, results.commit, results.machine);
  text += "Energy is not measured: CPU seconds stand in for it.\n";
  for (const ExperimentResult& result : results.experiments) {
    text += fmt::format("\n## {}\n\n*`mapp eval {}`, {:.0f} s.* {}\n", result.title, result.name, result.duration_s,
                        result.setup);
    for (const ResultTable& table : result.tables) AppendTable(table, has_plots, text);
    if (!result.paper.empty()) text += fmt::format("\nThe paper: {}\n", result.paper);
    if (!result.remarks.empty()) text += "\n";
    for (const std::string& remark : result.remarks) text += fmt::format("- {}\n", remark);
  }
  return text;
}

}  // namespace mapp
