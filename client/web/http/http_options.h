// What the server for browsers is told.
#pragma once

#include <chrono>
#include <cstddef>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>

#include "common/wire/address.h"

namespace palpate::web {

struct HttpTimeouts {
  // For TLS, and again from there to the end of the first request's header and body.
  std::chrono::milliseconds request = std::chrono::seconds(10);
  // The same from one answer to the end of the next request.
  std::chrono::milliseconds keep_alive = std::chrono::seconds(30);
  // For a message to a guest, and for an answer: to that, the time of its bytes at the lowest rate.
  std::chrono::milliseconds write = std::chrono::seconds(5);
  std::size_t lowest_bytes_per_ms = 64;
  // For a guest that leaves as many poses unacknowledged as it may.
  std::chrono::milliseconds acknowledge = std::chrono::seconds(10);
  // How often guests are looked at. Adds to the two above.
  std::chrono::milliseconds sweep = std::chrono::seconds(1);
};

struct HttpOptions {
  HostPort listen{"127.0.0.1", 7480};  // an IP address, or localhost; port 0: the system's choice
  // What guests type, such as "https://palpate.example.org" or "https://lab.example/palpate/".
  // Empty: loopback only.
  std::string public_url;
  std::filesystem::path certificate_file, key_file;  // PEM; empty: no TLS
  bool behind_proxy = false;  // the last X-Forwarded-For entry is the browser's address
  std::filesystem::path page_folder;
  int max_guests = 250;
  int max_connections = 1024;
  int max_strangers = 64;  // of the connections: without a login
  // Of answers that are being written. A body that several connections share counts once.
  std::size_t max_held_bytes = std::size_t{256} << 20;
  HttpTimeouts timeouts{};
};

// What the server tells of, on the network thread. Any may be empty.
struct HttpEvents {
  // One line without secrets. Refusals are told at most once a second and kind.
  std::function<void(const std::string& line)> log;
  // Every refusal, by its kind: a word such as "origin". The same words at every start.
  std::function<void(std::string_view kind)> refused;
  std::function<void(int status, std::size_t body_bytes)> answered;
  std::function<void()> joined;
  // "": the guest went. Otherwise the kind of what it was dropped for.
  std::function<void(std::string_view kind)> left;
  std::function<void(std::size_t bytes)> streamed;  // a message to a guest
  std::function<void()> skipped;                    // a pose that a slow guest does not get
};

}  // namespace palpate::web
