#pragma once

#include "mapp/base/status.h"

#include <istream>
#include <ostream>
#include <string>

namespace mapp {

/// What a person is asked before something is done that cannot be undone with a keystroke.
struct Question {
  std::string text;          ///< without " [y/N] "
  std::string doing;         ///< "deleting a map"
  std::string not_done;      ///< "nothing was deleted"
  bool yes = false;          ///< do not ask
  bool interactive = false;  ///< a person can answer
};

/// OK when the answer is yes; CANCELLED when it is another; FAILED_PRECONDITION when nobody can answer.
Status Confirm(const Question& question, std::istream& in, std::ostream& out);

}  // namespace mapp
