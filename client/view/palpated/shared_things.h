// What is for everyone: who changed it last, and whether this viewer did.
//
// Things have the names of client::LastChange::what. Two viewers may have one identity on one
// machine, such as the local socket. So a change counts as this viewer's own if its identity and
// machine are ours and we changed the same thing at that time.
//
// Threads: one at a time.
#pragma once

#include <chrono>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "client/sdk/activity.h"

namespace palpate::view {

// "token ada at ipv4:192.0.2.7:51544" as "token ada at 192.0.2.7".
std::string WithoutPort(std::string_view by);
// "now", "3 s", "2 min", "5 h".
std::string AgeInWords(double age_s);
// "token ada at 192.0.2.7, 3 s ago".
std::string ByAndAge(const std::string& by, double age_s);
// The name for people: "stiffness" for "stiffness_n_per_mm".
std::string NameOfThing(std::string_view what);
// Who changed one of `things` last: "token ada at 192.0.2.7, 3 s ago"; empty: nobody that the
// daemon knows.
std::string ChangedByInWords(const client::Activity& activity,
                             std::initializer_list<std::string_view> things);

class SharedThings {
 public:
  using Clock = std::chrono::steady_clock;
  // A change of somebody else is pointed out for this long.
  static constexpr std::chrono::seconds kFresh{6};

  // This viewer changes the thing now.
  void NoteOwn(std::string_view what, Clock::time_point now = Clock::now());
  // Takes an answer of palpated, which came at `came`; none: it is away.
  void Take(const std::optional<client::Activity>& activity, Clock::time_point came);

  struct Change {
    std::string by{};  // without the port
    double age_s = 0.0;
    bool is_own = false;    // of this viewer
    bool is_fresh = false;  // of somebody else, just now
  };
  std::optional<Change> Of(std::string_view what, Clock::time_point now = Clock::now()) const;
  // The newest change by somebody else as a line, such as "isovalue by token ada at 192.0.2.7, 3 s
  // ago"; empty if it is not fresh.
  std::string FreshLine(Clock::time_point now = Clock::now()) const;

 private:
  struct Known {
    std::string by{};
    Clock::time_point at{};
    bool is_ours = false;  // by our identity, from this machine
  };

  std::map<std::string, Clock::time_point, std::less<>> own_;
  std::map<std::string, Known, std::less<>> known_;
};

}  // namespace palpate::view
