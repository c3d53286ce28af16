#include "client/web/http/quiet_log.h"

#include <chrono>

#include "common/error/text.h"

namespace palpate::web {

void QuietLog::Refused(std::string_view kind, const std::string& line, Time now) {
  if (events_.refused) events_.refused(kind);
  Note(kind, "refused (" + std::string(kind) + "): " + line, now);
}

void QuietLog::Note(std::string_view kind, const std::string& line, Time now) {
  if (!events_.log) return;
  auto found = kinds_.find(kind);
  if (found == kinds_.end()) found = kinds_.emplace(std::string(kind), Kind{}).first;
  Kind& budget = found->second;
  if (budget.last != Time() && now - budget.last < std::chrono::seconds(1)) {
    ++budget.left_out;
    return;
  }
  const std::string more =
      budget.left_out == 0 ? "" : " (and " + std::to_string(budget.left_out) + " more since)";
  budget = {now, 0};
  Always(line.substr(0, 300) + more);
}

void QuietLog::Always(const std::string& line) {
  if (events_.log) events_.log(OneLine(line));
}

}  // namespace palpate::web
