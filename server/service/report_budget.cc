#include "server/service/report_budget.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace mapp {
namespace {

/// Beyond so many, sessions that have not reported for long are forgotten: they have all of their budget anyway.
constexpr size_t kMaxBuckets = 4096;

}  // namespace

ReportBudget::Bucket ReportBudget::Filled(const Bucket& bucket, std::chrono::steady_clock::time_point now) const {
  const double minutes = std::chrono::duration<double, std::ratio<60>>(now - bucket.filled).count();
  return {std::min(limits_.max_reports_at_once, bucket.num_reports + minutes * limits_.reports_per_minute),
          std::min(limits_.max_points_at_once, bucket.num_points + minutes * limits_.points_per_minute), now};
}

void ReportBudget::ForgetFull(std::chrono::steady_clock::time_point now) {
  std::erase_if(buckets_, [&](const auto& entry) {
    const Bucket bucket = Filled(entry.second, now);
    return bucket.num_reports >= limits_.max_reports_at_once && bucket.num_points >= limits_.max_points_at_once;
  });
}

Status ReportBudget::Take(SessionId session, size_t num_points) {
  const auto now = limits_.now();
  MutexLock lock(mutex_);
  if (buckets_.size() >= kMaxBuckets) ForgetFull(now);
  const Bucket full{limits_.max_reports_at_once, limits_.max_points_at_once, now};
  Bucket& bucket = buckets_.try_emplace(session, full).first->second;
  bucket = Filled(bucket, now);
  const double missing_reports = 1 - bucket.num_reports;
  const double missing_points = static_cast<double>(num_points) - bucket.num_points;
  if (missing_reports <= 0 && missing_points <= 0) {
    bucket.num_reports -= 1;
    bucket.num_points -= static_cast<double>(num_points);
    return absl::OkStatus();
  }
  const double minutes =
      std::max(missing_reports / limits_.reports_per_minute, missing_points / limits_.points_per_minute);
  return absl::ResourceExhaustedError(
      fmt::format("session {} reports more evidence than {} reports and {} points a minute: try again in {:.0f} s",
                  session.value(), limits_.reports_per_minute, limits_.points_per_minute, std::ceil(60 * minutes)));
}

}  // namespace mapp
