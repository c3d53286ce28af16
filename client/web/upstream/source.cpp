#include "client/web/upstream/source.h"

#include "client/sdk/device.h"
#include "client/web/upstream/topic_text.h"
#include "common/error/text.h"

namespace palpate::web {

std::string Source::Hello(const std::string& user,
                          const std::vector<std::string>& may_steer) const {
  return HelloText({.version = common_.version,
                    .user = user,
                    .may_steer = may_steer,
                    .may_stop = MayStop(),
                    .server_time_ms = NowMs()});
}

std::optional<double> Source::pose_age_s() const {
  const std::int64_t time_ns = pose_time_ns_;
  if (time_ns == 0) return std::nullopt;
  return 1e-9 * static_cast<double>(MonotonicNs() - time_ns);
}

bool Source::TellSteered(const SteerRequest& request, const std::string& error) {
  constexpr std::int64_t kBetweenStops_ms = 1000;
  const bool is_stop = request.key == client::kStopKey;
  if (is_stop && NowMs() - stop_told_ms_ < kBetweenStops_ms) return false;
  if (is_stop) stop_told_ms_ = NowMs();
  common_.steered(error.empty());
  const std::string line =
      request.user + (is_stop ? std::string(" stops the forces")
                              : " sets " + request.key + " to " + std::to_string(request.value));
  common_.log(error.empty() ? line : line + ": refused: " + OneLine(error));
  return true;
}

}  // namespace palpate::web
