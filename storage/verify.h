#pragma once

#include "mapp/base/call_context.h"
#include "mapp/base/status.h"

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace mapp {

/// Something that no map database has which only a server has written.
struct Violation {
  std::string check;          ///< name of the check that found it: docs/formats/database.md
  std::string what;           ///< what has the id: "frame", "point", "tile", ...
  std::optional<int64_t> id;  ///< absent when it is about the file or a table
  std::string message;        ///< one line
};

/// Violations of one check beyond those that are listed.
struct UnlistedViolations {
  std::string check;
  int64_t count = 0;
};

struct VerifyReport {
  std::vector<Violation> violations;
  std::vector<UnlistedViolations> unlisted;
  int num_checks = 0;
  int64_t num_maps = 0;
  int64_t num_keyframes = 0;
  int64_t num_points = 0;

  int64_t num_violations() const;
};

struct VerifyProgress {
  std::string check;  ///< under way
  int num_done = 0;   ///< checks before it
  int num_checks = 0;
};

struct VerifyOptions {
  /// Whether a place block can be decoded: storage does not know their format. Not checked without.
  std::function<Status(std::string_view block)> check_place_block = {};
  std::function<void(const VerifyProgress&)> on_progress = {};
  /// Violations a check lists, at least 1; more are counted.
  int max_listed = 100;
};

/// Looks for everything that is wrong with a map database: the file, its checksums, references and invariants. Reads
/// one commit's state while others write; the write-ahead log keeps what they write until it ends. Where a damaged
/// file keeps a check from its end, that is a violation of the check "sqlite", and the other checks go on.
///   CANCELLED            as `context` says; or DEADLINE_EXCEEDED
///   DATA_LOSS            too damaged to be opened
///   FAILED_PRECONDITION  no map database, another schema than this program's, no permission
///   NOT_FOUND            no such file
/// Messages name the file.
StatusOr<VerifyReport> VerifyDatabase(const CallContext& context, const std::string& database,
                                      const VerifyOptions& options = {});

}  // namespace mapp
