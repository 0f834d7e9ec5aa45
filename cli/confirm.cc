#include "cli/confirm.h"

#include <fmt/format.h>

namespace mapp {

Status Confirm(const Question& question, std::istream& in, std::ostream& out) {
  if (question.yes) return absl::OkStatus();
  if (!question.interactive) {
    return absl::FailedPreconditionError(fmt::format("{} needs --yes when nobody can be asked", question.doing));
  }
  out << question.text << " [y/N] " << std::flush;
  std::string answer;
  std::getline(in, answer);
  if (answer == "y" || answer == "Y" || answer == "yes") return absl::OkStatus();
  return absl::CancelledError(question.not_done);
}

}  // namespace mapp
