// A palpated that the viewer starts for its user: simulated device, a sample volume, a socket of
// this machine. It ends with the object, unless the user keeps it.
//
// Its clients may load from and save to the user's home. It logs to palpated.log in the folder that
// the caller names.
// Threads: one. Only End and the destructor wait.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include "client/view/palpated/child_program.h"

namespace palpate::view {

// palpated beside the program that runs, or else in `path_variable`; empty: there is none.
std::filesystem::path FindPalpated(const std::filesystem::path& own_folder,
                                   const std::string& path_variable);

// The last line that is not empty, without the log's time and level; empty: there is none.
std::string LastLineOf(const std::filesystem::path& log);

// True if a program listens on the socket.
bool IsServed(const std::string& socket);

class LocalDaemon {
 public:
  ~LocalDaemon();

  // Starts it, unless it runs. A problem is then in problem(). `log_folder`: made if it is missing.
  // `fresh`: with the sample. Otherwise with what was felt last.
  void Start(const std::string& socket, const std::filesystem::path& log_folder, bool fresh);
  // Takes note of its end. Call it once per frame.
  void Poll();
  bool runs() const { return program_ != nullptr; }
  // True if it runs and this is its address, such as "unix:/run/palpated.sock".
  bool Serves(const std::string& address) const;
  // Takes note of the edits that are not saved at this address, if it is its own.
  void NoteUnsaved(const std::string& address, std::uint64_t edits);
  // As noted last.
  std::uint64_t unsaved_edits() const { return unsaved_edits_; }
  // True if edits are lost when the object ends.
  bool LosesEdits() const { return runs() && !kept_ && unsaved_edits_ > 0; }
  // Why it did not start, or that it ended; empty: neither.
  const std::string& problem() const { return problem_; }
  // It goes on when the viewer ends.
  bool is_kept() const { return kept_; }
  void Keep(bool kept) { kept_ = kept; }
  const std::filesystem::path& log() const { return log_; }

 private:
  std::unique_ptr<ChildProgram> program_;
  std::filesystem::path log_;
  std::string address_;
  std::uint64_t unsaved_edits_ = 0;
  std::string problem_;
  bool kept_ = false;
};

}  // namespace palpate::view
