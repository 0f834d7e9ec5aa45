// An app outside the project: sees the installed headers and mapp::client, nothing else.

#include <mapp/client/device.h>

#include <cstdio>

int main() {
  mapp::MapClientOptions options;
  options.server_address = "127.0.0.1:1";  // nobody listens there
  options.retry_for = std::chrono::milliseconds(0);
  const auto client = mapp::MapClient::Create(options);
  if (!client.ok()) return 1;
  const auto closed = (*client)->CloseSession(mapp::SessionId(1));
  std::printf("%s\n", closed.status().ToString().c_str());
  return absl::IsUnavailable(closed.status()) ? 0 : 1;
}
