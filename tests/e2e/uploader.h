#pragma once

#include "mapp/base/id.h"
#include "mapp/client/map_client.h"
#include "storage/map_store.h"

#include <atomic>
#include <cstdint>
#include <memory>
#include <semaphore>
#include <string>
#include <thread>

namespace mapp {

struct UploaderOptions {
  std::string server;
  std::string map = "room";
  int number = 0;  ///< of the device
  /// Of its features, every n-th is sent: a small map is quickly looked through.
  int keep_every = 1;
  /// Waits for Allow() before each keyframe.
  bool waits = false;
  /// Released once for each keyframe that is acknowledged.
  std::counting_semaphore<>* acknowledged = nullptr;
};

/// What must be there of a session: keyframes 0 to `count` less one.
struct AcknowledgedKeyframes {
  SessionId session;
  uint32_t count = 0;
};

/// A device that walks through the synthetic room and uploads one keyframe after the other until told to stop, through
/// whatever its client bears.
class Uploader {
 public:
  explicit Uploader(const UploaderOptions& options);
  ~Uploader();
  Uploader(const Uploader&) = delete;
  Uploader& operator=(const Uploader&) = delete;

  /// Keyframes 0 to this number less one are acknowledged.
  uint32_t num_acknowledged() const { return num_acknowledged_; }
  AcknowledgedKeyframes acknowledged() const { return {session_, num_acknowledged_}; }
  void Allow(int num_keyframes) { allowed_.release(num_keyframes); }
  /// Attempts that came to nothing because the server went away.
  uint64_t num_retries() const { return num_retries_; }
  /// Closes the session.
  void Stop();

 private:
  void Run(const std::stop_token& stop);

  const UploaderOptions options_;
  std::unique_ptr<MapClient> client_;
  SessionId session_;
  std::atomic<uint32_t> num_acknowledged_{0};
  uint64_t num_retries_ = 0;  ///< once stopped
  std::counting_semaphore<> allowed_{0};
  std::jthread thread_;
};

/// Fails the present test unless the session's keyframes are there once each, whole, and at least those.
void ExpectKeyframes(MapReader& reader, const AcknowledgedKeyframes& acknowledged);

}  // namespace mapp
