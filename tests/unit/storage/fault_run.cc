#include "tests/unit/storage/fault_run.h"

#include "storage/memory/memory_map_store.h"
#include "storage/sqlite/backup.h"
#include "storage/verify.h"
#include "tests/unit/storage/fault_script.h"
#include "tests/unit/storage/fault_vfs.h"
#include "tests/unit/storage/map_dump.h"
#include "tests/unit/storage/store_fixture.h"

#include <fmt/format.h>

#include <filesystem>
#include <optional>

namespace mapp {
namespace {

constexpr int kStepsBetweenOpenings = 13;
constexpr int kStepsBetweenBackups = 10;
/// How often a lasting fault is met by the same step before it ends.
constexpr int kRefusalsOfALastingFault = 3;

class FaultRun {
 public:
  FaultRun(const DiskFault& fault, const FaultRunOptions& options)
      : disk_(DiskUnderSqlite()), fault_(fault), ends_when_refused_(options.ends_when_refused) {
    options_.page_size_bytes = options.page_bytes;
    options_.sync_commits = options.sync_commits;
    options_.unix_now_ns = [this] { return now_ns_; };
    mirror_ = Value(OpenMemoryMapStore(CreateMemoryDatabase(), {.unix_now_ns = options_.unix_now_ns}));
    disk_.Start(folder_.path().string());
    disk_.Insert(fault);
  }

  FaultRunResult Run() {
    for (int step = 0; step < kNumScriptSteps && !disk_.is_off(); ++step) {
      if (step % kStepsBetweenOpenings == 0) Reopen();
      if (step % kStepsBetweenBackups == kStepsBetweenBackups - 1) BackUp(step);
      if (store_ != nullptr) DoStep(step);
    }
    result_.num_operations = disk_.num_operations();
    result_.operations = disk_.operations();
    // Half of the runs end as a server does that is told to.
    if (fault_.seed % 2 == 0 && store_ != nullptr && !disk_.is_off()) Close();
    disk_.CutPower();
    store_.reset();
    result_.struck = disk_.struck();
    disk_.Reboot();
    LookAtWhatIsLeft();
    return std::move(result_);
  }

 private:
  bool IsLasting() const { return fault_.kind == DiskFault::Kind::kFailFrom || fault_.kind == DiskFault::Kind::kFull; }

  void Problem(const std::string& what) {
    result_.problems.push_back(fmt::format("kind {} at {} seed {} ({}): {}", static_cast<int>(fault_.kind), fault_.at,
                                           fault_.seed, disk_.struck(), what));
  }

  /// Does it until it succeeds, as a device would; false when the power is gone.
  template <typename Action>
  bool Insist(const std::string& what, const Action& action) {
    for (int attempt = 1;; ++attempt) {
      if (disk_.is_off()) return false;
      const Status status = action();
      if (status.ok()) return true;
      if (disk_.is_off()) return false;
      ++result_.num_refused;
      CheckRefusal(what, status);
      if (ends_when_refused_) disk_.CutPower();
      if (IsLasting() && attempt == kRefusalsOfALastingFault) disk_.Heal();
      if (attempt > (IsLasting() ? kRefusalsOfALastingFault : 1)) {
        Problem(fmt::format("{} does not succeed after the fault: {}", what, status.ToString()));
        return false;
      }
    }
  }

  void CheckRefusal(const std::string& what, const Status& status) {
    if (disk_.struck().empty())
      return Problem(fmt::format("{} is refused without a fault: {}", what, status.ToString()));
    const bool is_full = fault_.kind == DiskFault::Kind::kFull;
    const bool is_expected = is_full ? absl::IsResourceExhausted(status) : absl::IsUnavailable(status);
    const std::string message(status.message());
    const bool is_clear = message.find(is_full ? "disk full" : "error") != std::string::npos ||
                          message.find("SQLite code") != std::string::npos;
    if (!is_expected || !is_clear || message.find('\n') != std::string::npos)
      Problem(fmt::format("{} is refused with {}", what, status.ToString()));
  }

  void Reopen() {
    if (store_ != nullptr) Close();
    store_.reset();
    Insist("opening", [&] {
      StatusOr<std::unique_ptr<MapStore>> opened = OpenSqliteMapStore(file_, options_);
      if (opened.ok()) store_ = *std::move(opened);
      return opened.status();
    });
  }

  void Close() {
    const Status status = store_->Close();
    if (!status.ok() && !disk_.is_off()) CheckRefusal("closing", status);
    if (IsLasting() && !status.ok()) disk_.Heal();
  }

  void DoStep(int step) {
    now_ns_ = 1'000 + step;
    in_flight_ = step;
    const bool done = Insist(fmt::format("step {}", step), [&] {
      Status status = store_->Write({}, [&](MapWriter& writer) { return RunScriptStep(writer, step); });
      // A full disk can be read, and a fault that was one is over.
      if (!status.ok() && fault_.kind != DiskFault::Kind::kFailFrom && !disk_.is_off()) CompareReads(step);
      return status;
    });
    if (!done) return;
    Mirror(step);
    ++result_.num_acknowledged;
    if (step % 8 == 7) CompareReads(step);
  }

  void Mirror(int step) {
    in_flight_.reset();
    Check(mirror_->Write({}, [&](MapWriter& writer) { return RunScriptStep(writer, step); }));
    mirrored_.clear();
  }

  const std::string& Mirrored() {
    if (mirrored_.empty()) mirrored_ = DumpAll(*Value(mirror_->Read()));
    return mirrored_;
  }

  /// The store's content; what reading it meets comes as UNAVAILABLE where its text says so.
  static StatusOr<std::string> Dump(MapStore& store) {
    try {
      return DumpAll(*Value(store.Read()));
    } catch (const std::runtime_error& error) {
      const std::string text = error.what();
      return text.starts_with("UNAVAILABLE") ? absl::UnavailableError(text) : absl::InternalError(text);
    }
  }

  void CompareReads(int step) {
    std::string dump;
    Insist(fmt::format("reading after step {}", step), [&] {
      StatusOr<std::string> dumped = Dump(*store_);
      if (dumped.ok()) dump = *std::move(dumped);
      return dumped.status();
    });
    if (!disk_.is_off() && dump != Mirrored()) Problem(fmt::format("after step {} another state is read", step));
  }

  void BackUp(int step) {
    const std::string target = folder_.File(fmt::format("backup{}.db", step));
    const bool done = Insist("backup", [&] {
      const Status status = BackUpDatabase({}, file_, {.to = target}).status();
      if (!status.ok() && std::filesystem::exists(target) && !disk_.is_off()) Problem("a failed backup left " + target);
      return status;
    });
    if (done) backups_.emplace_back(target, Mirrored());
  }

  void LookAtWhatIsLeft() {
    StatusOr<std::unique_ptr<MapStore>> opened = OpenSqliteMapStore(file_, options_);
    if (!opened.ok()) return Problem("what is left cannot be opened: " + opened.status().ToString());
    store_ = *std::move(opened);
    const StatusOr<std::string> left = Dump(*store_);
    if (!left.ok()) return Problem("what is left cannot be read: " + left.status().ToString());
    // What was not answered may be there or not, but whole; and what was refused, until a later change is durable.
    if (*left != Mirrored() && in_flight_) Mirror(*in_flight_);
    if (*left != Mirrored()) Problem("what is left is not what was acknowledged");
    Verify(file_);
    for (const auto& [backup, content] : backups_) {
      const auto copy = OpenSqliteMapStore(backup, {.read_only = true});
      const StatusOr<std::string> dump = copy.ok() ? Dump(**copy) : copy.status();
      if (!dump.ok() || *dump != content) Problem("a finished backup is lost: " + dump.status().ToString());
    }
    for (const auto& entry : std::filesystem::directory_iterator(folder_.path())) {
      const std::string name = entry.path().filename().string();
      if (name.starts_with("backup") && name.ends_with(".db")) Verify(entry.path().string());
    }
    const Status written = store_->Write({}, [](MapWriter& writer) { return RunScriptStep(writer, kNumScriptSteps); });
    if (!written.ok()) Problem("what is left cannot be written: " + written.ToString());
    if (const Status closed = store_->Close(); !closed.ok()) Problem("closing: " + closed.ToString());
  }

  void Verify(const std::string& database) {
    const StatusOr<VerifyReport> report = VerifyDatabase({}, database);
    if (!report.ok()) return Problem("verify: " + report.status().ToString());
    for (const Violation& violation : report->violations) {
      Problem(fmt::format("verify {}: {}: {}", database, violation.check, violation.message));
    }
  }

  FaultDisk& disk_;
  const DiskFault fault_;
  const bool ends_when_refused_;
  const TempFolder folder_;
  const std::string file_ = folder_.File("maps.db");
  SqliteOptions options_;
  int64_t now_ns_ = 1'000;
  std::unique_ptr<MapStore> store_;
  std::unique_ptr<MapStore> mirror_;
  std::string mirrored_;                                      ///< the mirror's content; empty when it has changed since
  std::optional<int> in_flight_;                              ///< the step that may or may not have been done
  std::vector<std::pair<std::string, std::string>> backups_;  ///< finished, and what they must hold
  FaultRunResult result_;
};

}  // namespace

FaultRunResult RunOnFaultyDisk(const DiskFault& fault, const FaultRunOptions& options) {
  return FaultRun(fault, options).Run();
}

}  // namespace mapp
