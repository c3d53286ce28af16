#include "server/app/unread_log.h"

#include <fmt/format.h>
#include <poll.h>
#include <spdlog/sinks/base_sink.h>
#include <unistd.h>

#include <cstdint>
#include <mutex>
#include <string>
#include <utility>

namespace palpate {
namespace {

// A reader may be busy for a short time.
constexpr int kPatienceMs = 200;

bool StderrTakesMore(int wait_ms) {
  pollfd stream{.fd = STDERR_FILENO, .events = POLLOUT, .revents = 0};
  return poll(&stream, 1, wait_ms) == 1;
}

class UnreadLog final : public spdlog::sinks::base_sink<std::mutex> {
 public:
  explicit UnreadLog(spdlog::sink_ptr to_stderr) : to_stderr_(std::move(to_stderr)) {}

 protected:
  void sink_it_(const spdlog::details::log_msg& message) override {
    if (!StderrTakesMore(dropped_ == 0 ? kPatienceMs : 0)) {
      ++dropped_;
      return;
    }
    if (dropped_ > 0) {
      const std::string text = fmt::format("{} line{} of the log dropped: nobody read it", dropped_,
                                           dropped_ == 1 ? "" : "s");
      to_stderr_->log({message.logger_name, spdlog::level::warn, text});
      dropped_ = 0;
      if (!StderrTakesMore(0)) {
        dropped_ = 1;
        return;
      }
    }
    to_stderr_->log(message);
  }
  void flush_() override { to_stderr_->flush(); }
  void set_pattern_(const std::string& pattern) override { to_stderr_->set_pattern(pattern); }
  void set_formatter_(std::unique_ptr<spdlog::formatter> formatter) override {
    to_stderr_->set_formatter(std::move(formatter));
  }

 private:
  spdlog::sink_ptr to_stderr_;
  std::uint64_t dropped_ = 0;
};

}  // namespace

std::shared_ptr<spdlog::sinks::sink> DroppingWhileUnread(
    std::shared_ptr<spdlog::sinks::sink> to_stderr) {
  return std::make_shared<UnreadLog>(std::move(to_stderr));
}

}  // namespace palpate
