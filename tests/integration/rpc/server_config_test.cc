#include "server/config.h"
#include "tests/support/process.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <vector>

namespace mapp {
namespace {

using ::testing::HasSubstr;
using ::testing::internal::CaptureStderr;
using ::testing::internal::GetCapturedStderr;

class ServerConfigTest : public ::testing::Test {
 protected:
  ~ServerConfigTest() override {
    unsetenv("MAPP_CACHE_MB");
    unsetenv("MAPP_DRAIN_SECONDS");
  }
  static ParsedConfig Parse(std::vector<const char*> arguments) {
    arguments.insert(arguments.begin(), "mapp-server");
    return ParseServerConfig(static_cast<int>(arguments.size()), arguments.data(), "1.2.3");
  }
  /// What the operator reads when the arguments are refused.
  static std::string Refusal(const std::vector<const char*>& arguments) {
    CaptureStderr();
    const ParsedConfig parsed = Parse(arguments);
    EXPECT_EQ(parsed.exit_code, 2);
    return GetCapturedStderr();
  }
  std::string ConfigFile(const std::string& content) {
    const std::string file = folder_.File("server.toml");
    std::ofstream(file) << content;
    return file;
  }
  TempFolder folder_;
};

TEST_F(ServerConfigTest, DefaultsAreLoopbackAndModest) {
  const ParsedConfig parsed = Parse({"--db", "maps.db"});
  ASSERT_FALSE(parsed.exit_code.has_value());
  EXPECT_EQ(parsed.config.database_file, "maps.db");
  EXPECT_EQ(parsed.config.listen_address, "127.0.0.1:7878");
  EXPECT_EQ(parsed.config.cache_mb, 256);
  EXPECT_EQ(parsed.config.drain, std::chrono::seconds(10));
}

TEST_F(ServerConfigTest, FlagsWinOverTheFileAndTheFileOverTheEnvironment) {
  setenv("MAPP_CACHE_MB", "11", 1);
  setenv("MAPP_DRAIN_SECONDS", "12", 1);
  const std::string file = ConfigFile("db = \"maps.db\"\ncache-mb = 21\nlog-level = \"error\"\n");
  const ParsedConfig parsed = Parse({"--config", file.c_str(), "--log-level", "debug"});
  ASSERT_FALSE(parsed.exit_code.has_value());
  EXPECT_EQ(parsed.config.database_file, "maps.db");
  EXPECT_EQ(parsed.config.log_level, "debug");
  EXPECT_EQ(parsed.config.cache_mb, 21);
  EXPECT_EQ(parsed.config.drain, std::chrono::seconds(12));
}

TEST_F(ServerConfigTest, WrongUsageIsOneLineThatNamesTheOption) {
  EXPECT_THAT(Refusal({}), HasSubstr("--db"));
  EXPECT_THAT(Refusal({"--db", "maps.db", "--cache-mb", "0"}), HasSubstr("--cache-mb"));
  EXPECT_THAT(Refusal({"--db", "maps.db", "--listen", "7878"}), HasSubstr("HOST:PORT"));
  EXPECT_THAT(Refusal({"--db", "maps.db", "--listen", "127.0.0.1:70000"}), HasSubstr("70000"));
  EXPECT_THAT(Refusal({"--db", "maps.db", "--log-level", "loud"}), HasSubstr("--log-level"));
  EXPECT_THAT(Refusal({"--db", "maps.db", "--frobnicate"}), HasSubstr("--frobnicate"));
}

TEST_F(ServerConfigTest, TheBackupFolderIsThere) {
  EXPECT_EQ(Parse({"--db", "maps.db"}).config.backup_folder, "");
  const std::string folder = folder_.path().string();
  EXPECT_EQ(Parse({"--db", "maps.db", "--backup-dir", folder.c_str()}).config.backup_folder, folder);
  EXPECT_THAT(Refusal({"--db", "maps.db", "--backup-dir", "/no/such/folder"}), HasSubstr("/no/such/folder"));
}

TEST_F(ServerConfigTest, UnknownKeysInTheFileAreErrors) {
  const std::string file = ConfigFile("db = \"maps.db\"\ncash-mb = 21\n");
  EXPECT_THAT(Refusal({"--config", file.c_str()}), HasSubstr("cash-mb"));
}

TEST_F(ServerConfigTest, AMissingConfigFileIsNamed) {
  EXPECT_THAT(Refusal({"--db", "maps.db", "--config", "/no/such/file.toml"}), HasSubstr("/no/such/file.toml"));
}

TEST_F(ServerConfigTest, BeyondLoopbackOnlyWhenToldSo) {
  EXPECT_THAT(Refusal({"--db", "maps.db", "--listen", "0.0.0.0:7878"}), HasSubstr("--insecure-listen-any"));
  EXPECT_THAT(Refusal({"--db", "maps.db", "--metrics-listen", "0.0.0.0:9090"}), HasSubstr("--metrics-listen"));
  EXPECT_FALSE(Parse({"--db", "maps.db", "--listen", "0.0.0.0:7878", "--insecure-listen-any"}).exit_code.has_value());
}

TEST_F(ServerConfigTest, LoopbackIsKnownByItsAddress) {
  for (const char* address : {"127.0.0.1:1", "127.1.2.3:1", "localhost:1", "[::1]:1"}) {
    EXPECT_TRUE(IsLoopback(address)) << address;
  }
  for (const char* address : {"0.0.0.0:1", "[::]:1", "192.168.0.1:1", "127.evil.example:1", "localhost.evil:1"}) {
    EXPECT_FALSE(IsLoopback(address)) << address;
  }
}

}  // namespace
}  // namespace mapp
