#pragma once

#include "mapp/base/id.h"
#include "mapp/base/mutex.h"
#include "server/service/keyframe_evidence.h"

#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <unordered_map>

namespace mapp {

struct JudgeOptions {
  /// Keyframes that contradict in a way that no honest session does, among so many latest that said anything.
  size_t max_false_keyframes = 3;
  size_t num_latest = 5;
  /// Keyframes that stand elsewhere, without one between them that agrees.
  size_t max_elsewhere = 4;
  /// The same of views unlike the map, which are some steps apart: a changed world shows them, too, but not for long.
  size_t max_unlike = 8;
};

/// Why a session is to be quarantined.
struct Ruling {
  Finding finding = Finding::kSilent;
  std::string reason;
  /// The first keyframe that the ruling rests on.
  uint32_t first_contradiction = 0;
  /// The session's keyframes from this number on came after the last one that is vouched for.
  uint32_t first_suspect = 0;
};

/// Adds up what the keyframes of each session say. Knows only what it was told since the process began: what a session
/// sent before counts as vouched for. Thread-safe.
class SessionJudge {
 public:
  explicit SessionJudge(const JudgeOptions& options = {}) : options_(options) {}

  /// A keyframe's word; said twice, the later one counts. Findings may come late (kElsewhere, kUnlike and kAgrees of
  /// doubtful keyframes): those of keyframes before the last one that agreed say nothing any more.
  std::optional<Ruling> Add(SessionId session, uint32_t keyframe, const KeyframeEvidence& evidence);
  void Forget(SessionId session);

 private:
  struct Word {
    uint32_t keyframe = 0;
    KeyframeEvidence evidence;
  };
  struct Record {
    uint32_t first_suspect = 0;  ///< after the last keyframe that agreed; else the first that was heard of
    std::deque<Word> latest;     ///< those that said anything of themselves, options.num_latest at most
    std::deque<Word> misplaced;  ///< kElsewhere and kUnlike since the last one that agreed
  };

  void Agree(Record& record, uint32_t keyframe) const;
  std::optional<Ruling> RuleOnFalse(const Record& record) const;
  std::optional<Ruling> RuleOnMisplaced(const Record& record, Finding finding, size_t limit) const;

  const JudgeOptions options_;
  Mutex mutex_;
  std::unordered_map<SessionId, Record> records_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace mapp
