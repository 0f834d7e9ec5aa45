#include "eval/harness/results.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace mapp {
namespace {

using testing::HasSubstr;

ResultSet SomeResults() {
  ResultTable table;
  table.id = "traffic_garage";
  table.title = "Upload";
  table.columns = {{"user", 0}, {"upload, KB", 1}, {"note"}};
  table.rows = {{1.0, 41.25, "founds \"the\" map"}, {2.0, std::optional<double>(), "x"}};
  table.plot = Plot{Plot::Kind::kBars, "user", {"upload, KB"}, "KB"};
  ExperimentResult experiment;
  experiment.name = "traffic";
  experiment.title = "Upload traffic";
  experiment.setup = "garage, 2 users.";
  experiment.paper = "46 % less.";
  experiment.tables = {table};
  experiment.remarks = {"A remark."};
  experiment.duration_s = 12.5;
  ResultSet results;
  results.version = "1.2.3";
  results.commit = "abc";
  results.machine = "a machine";
  results.command = "mapp eval traffic";
  results.scale = "quick";
  results.seed = 7;
  results.experiments = {experiment};
  return results;
}

TEST(ResultsTest, ReadBackAsWritten) {
  const std::string json = FormatResults(SomeResults());
  const auto read = ParseResults(json, "results.json");
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(FormatResults(*read), json);
  EXPECT_EQ(read->seed, 7U);
  EXPECT_EQ(read->experiments[0].tables[0].rows[0][1].number, 41.25);
  EXPECT_FALSE(read->experiments[0].tables[0].rows[1][1].number.has_value());
}

TEST(ResultsTest, AnotherFormatIsRefusedByNumber) {
  std::string json = FormatResults(SomeResults());
  const size_t at = json.find("\"format\": 1");
  ASSERT_NE(at, std::string::npos);
  json.replace(at, 11, "\"format\": 9");
  const auto read = ParseResults(json, "old/results.json");
  EXPECT_EQ(read.status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(read.status().message()),
              testing::AllOf(HasSubstr("old/results.json"), HasSubstr("format 9"), HasSubstr("format 1")));
}

TEST(ResultsTest, WhatIsNoResultsFileIsDataLoss) {
  for (const char* json :
       {"", "{", "[]", "{}", R"({"format": "1"})", R"({"format": 1})", R"({"format": 1, "version": 3})"}) {
    EXPECT_EQ(ParseResults(json, "f").status().code(), absl::StatusCode::kDataLoss) << json;
  }
}

TEST(ResultsTest, AnExperimentReplacesItsEarlierRun) {
  ResultSet results = SomeResults();
  ExperimentResult again = results.experiments[0];
  again.duration_s = 99;
  Merge(again, results);
  ASSERT_EQ(results.experiments.size(), 1U);
  EXPECT_EQ(results.experiments[0].duration_s, 99);
  again.name = "hall";
  Merge(again, results);
  EXPECT_EQ(results.experiments.size(), 2U);
}

TEST(ResultsTest, CsvQuotesWhatNeedsIt) {
  EXPECT_EQ(FormatCsv(SomeResults().experiments[0].tables[0]),
            "user,\"upload, KB\",note\n1,41.25,\"founds \"\"the\"\" map\"\n2,,x\n");
}

TEST(ResultsTest, TheReportHoldsTablesPaperAndOrigin) {
  const std::string with_plots = FormatReport(SomeResults(), /*has_plots=*/true);
  for (const char* part : {"| 1 | 41.2 |", "| 2 | – | x |", "46 % less.", "- A remark.", "commit abc", "a machine",
                           "mapp eval traffic", "seed 7", "![Upload](traffic_garage.png)"}) {
    EXPECT_THAT(with_plots, HasSubstr(part));
  }
  EXPECT_THAT(FormatReport(SomeResults(), /*has_plots=*/false), testing::Not(HasSubstr(".png")));
}

}  // namespace
}  // namespace mapp
