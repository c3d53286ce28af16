// Logs refusals and guests' logins: one line a second for each kind, so that a flood does not fill
// the log.
//
// Threads: one.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>

#include "client/web/http/http_options.h"
#include "client/web/logins/sessions.h"

namespace palpate::web {

class QuietLog {
 public:
  explicit QuietLog(const HttpEvents& events) : events_(events) {}

  // `kind`: one word of few. `line` may have text of strangers in it.
  void Refused(std::string_view kind, const std::string& line, Time now);
  void Note(std::string_view kind, const std::string& line, Time now);
  // For what no flood of strangers can bring.
  void Always(const std::string& line);

 private:
  struct Kind {
    Time last{};
    std::uint64_t left_out = 0;
  };
  const HttpEvents& events_;
  std::map<std::string, Kind, std::less<>> kinds_;
};

}  // namespace palpate::web
