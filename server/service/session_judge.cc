#include "server/service/session_judge.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <utility>
#include <vector>

namespace mapp {
namespace {

/// What a reason begins with, and what an operator may look for.
struct Explanation {
  const char* what;
  const char* cause;
};

Explanation Explain(Finding finding) {
  switch (finding) {
    case Finding::kBadDepths:
      return {"depths that the sensor cannot have measured", "wrong depth scale or stereo baseline"};
    case Finding::kOwnPoints:
      return {"keyframes that do not fit the session's own points", "mis-tracking, or poses of another frame"};
    case Finding::kOwnDescriptors:
      return {"features that do not look like the points they name", "wrong descriptors or point numbers"};
    case Finding::kMapDepths:
      return {"depths that contradict the map's", "wrong depth scale or stereo baseline"};
    case Finding::kElsewhere:
      return {"keyframes that fit the map elsewhere than where the session places them",
              "mis-tracking, wrong calibration or a wrong alignment"};
    default:
      return {"views that show something else than the map holds there",
              "mis-tracking, wrong calibration or descriptors, or a place that has changed altogether"};
  }
}

template <typename Words>
Ruling MakeRuling(Finding finding, const Words& words, uint32_t first_suspect) {
  const Explanation explanation = Explain(finding);
  std::vector<uint32_t> keyframes;
  for (const auto& word : words) keyframes.push_back(word.keyframe);
  return {finding,
          fmt::format("{} (likely {}): keyframes {}; in keyframe {}, {}", explanation.what, explanation.cause,
                      fmt::join(keyframes, ", "), words.back().keyframe, words.back().evidence.figures),
          keyframes.front(), std::min(first_suspect, keyframes.front())};
}

}  // namespace

std::optional<Ruling> SessionJudge::Add(SessionId session, uint32_t keyframe, const KeyframeEvidence& evidence) {
  const MutexLock lock(mutex_);
  Record& record = records_.try_emplace(session, Record{keyframe, {}, {}}).first->second;
  if (evidence.finding == Finding::kSilent || evidence.finding == Finding::kDoubtful) return std::nullopt;
  if (evidence.finding == Finding::kElsewhere || evidence.finding == Finding::kUnlike) {
    if (keyframe < record.first_suspect) return std::nullopt;
    record.misplaced.push_back({keyframe, evidence});
    const bool elsewhere = evidence.finding == Finding::kElsewhere;
    return RuleOnMisplaced(record, evidence.finding, elsewhere ? options_.max_elsewhere : options_.max_unlike);
  }
  if (evidence.finding == Finding::kAgrees) Agree(record, keyframe);
  std::erase_if(record.latest, [&](const Word& word) { return word.keyframe == keyframe; });
  record.latest.push_back({keyframe, evidence});
  if (record.latest.size() > options_.num_latest) record.latest.pop_front();
  return IsFalse(evidence.finding) ? RuleOnFalse(record) : std::nullopt;
}

void SessionJudge::Agree(Record& record, uint32_t keyframe) const {
  record.first_suspect = std::max(record.first_suspect, keyframe + 1);
  std::erase_if(record.misplaced, [&](const Word& word) { return word.keyframe <= keyframe; });
}

std::optional<Ruling> SessionJudge::RuleOnFalse(const Record& record) const {
  std::vector<Word> bad;
  for (const Word& word : record.latest) {
    if (IsFalse(word.evidence.finding)) bad.push_back(word);
  }
  if (bad.size() < options_.max_false_keyframes) return std::nullopt;
  const Finding finding = bad.back().evidence.finding;
  // A session that contradicts itself was in order until then, whether or not the map could vouch for it.
  const bool by_map = finding == Finding::kMapDepths;
  return MakeRuling(finding, bad, by_map ? record.first_suspect : bad.front().keyframe);
}

std::optional<Ruling> SessionJudge::RuleOnMisplaced(const Record& record, Finding finding, size_t limit) const {
  std::vector<Word> same;
  for (const Word& word : record.misplaced) {
    if (word.evidence.finding == finding) same.push_back(word);
  }
  if (same.size() < limit) return std::nullopt;
  return MakeRuling(finding, same, record.first_suspect);
}

void SessionJudge::Forget(SessionId session) {
  const MutexLock lock(mutex_);
  records_.erase(session);
}

}  // namespace mapp
