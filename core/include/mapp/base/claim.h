#pragma once

#include <atomic>

namespace mapp {

/// Sets a flag while it lives, if nobody else has: for work that one caller at a time may ask for and others need not
/// wait for.
class Claim {
 public:
  explicit Claim(std::atomic<bool>& flag) : flag_(flag), is_mine_(!flag.exchange(true)) {}
  ~Claim() {
    if (is_mine_) flag_ = false;
  }
  Claim(const Claim&) = delete;
  Claim& operator=(const Claim&) = delete;
  bool is_mine() const { return is_mine_; }

 private:
  std::atomic<bool>& flag_;
  const bool is_mine_;
};

}  // namespace mapp
