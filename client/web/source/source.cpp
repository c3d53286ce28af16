#include "client/web/source/source.h"

#include "client/web/source/clock.h"
#include "client/web/source/topic_text.h"
#include "common/error/one_line.h"

namespace palpate::web {

std::string Source::Hello(const std::string& user,
                          const std::vector<std::string>& may_steer) const {
  return HelloText({.version = common_.version,
                    .user = user,
                    .may_steer = may_steer,
                    .server_time_ms = NowMs()});
}

std::optional<double> Source::pose_age_s() const {
  const std::int64_t time_ns = pose_time_ns_;
  if (time_ns == 0) return std::nullopt;
  return 1e-9 * static_cast<double>(MonotonicNs() - time_ns);
}

void Source::TellSteered(const SteerRequest& request, const std::string& error) {
  common_.steered(error.empty());
  const std::string line =
      request.user + " sets " + request.key + " to " + std::to_string(request.value);
  common_.log(error.empty() ? line : line + ": refused: " + OneLine(error));
}

}  // namespace palpate::web
