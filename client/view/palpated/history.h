// What the user did in this viewer, in the order in which it was done, for undo and redo.
//
// A step knows how it is undone and redone. Steps of things that are for everyone may fail, or
// become impossible because another client changed the same thing; they then no longer last, and
// the history drops them. The other steps stay.
//
// Threads: that of the frames. Errors: none; each step reports its own.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

namespace palpate::view {

// One thing that the user did.
struct Step {
  std::string name{};  // for people, such as "isovalue" or "stroke"
  // Undoes the step, or redoes it (`forward`). May only start it: then steps end in the order in
  // which they were started.
  std::function<void(bool forward)> go{};
  // False if the step can no longer be undone or redone. Empty: it always can.
  std::function<bool()> lasts{};
};

class History {
 public:
  static constexpr std::size_t kMost = 1000;  // older steps are forgotten

  // The user has done this. What was undone before can no longer be redone.
  void Add(Step step);
  // Undoes the newest step. Returns false if there is none.
  bool Undo() { return Move(done_, undone_, /*forward=*/false); }
  // Redoes the step that was undone last. Returns false if there is none.
  bool Redo() { return Move(undone_, done_, /*forward=*/true); }
  // What Undo or Redo would do next; empty: nothing.
  std::string undo_name() { return NameOfLast(done_); }
  std::string redo_name() { return NameOfLast(undone_); }
  void Forget();

 private:
  using Steps = std::vector<Step>;
  // Drops the steps at the end that no longer last.
  static void Trim(Steps& steps);
  static std::string NameOfLast(Steps& steps);
  static bool Move(Steps& from, Steps& to, bool forward);

  Steps done_;
  Steps undone_;  // the next to be redone is the last
};

}  // namespace palpate::view
