// Remembers where volumes lie, beyond the next volume and the next start.
//
// Kept in memory, and where a folder is given in its registrations.toml: a moment
// after a change, by a thread of its own, and at the end. A damaged file is set aside
// as registrations.toml.damaged and said in the log; so is a file that cannot be
// written. Neither stops anything.
//
// Threads: any ordinary thread; Keep and Find do not touch the disk.
// Ownership: of its thread.
#pragma once

#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "server/scene/registration.h"
#include "server/state/registration_file.h"

namespace palpate {

class RegistrationStore {
 public:
  // The oldest are forgotten.
  static constexpr std::size_t kMostEntries = 1000;
  // From a change until it is written, with all that changed meanwhile.
  static constexpr std::chrono::milliseconds kSaveDelay{1000};

  // Empty: nothing is written.
  explicit RegistrationStore(std::filesystem::path folder,
                             std::chrono::milliseconds save_delay = kSaveDelay);
  ~RegistrationStore();
  RegistrationStore(const RegistrationStore&) = delete;
  RegistrationStore& operator=(const RegistrationStore&) = delete;

  // Of a volume with this source, size and spacing.
  std::optional<Registration> Find(const VolumeMetadata& volume) const;
  void Keep(const VolumeMetadata& volume, const Registration& registration);

  // Writes what is not written yet, now.
  void Save();

 private:
  void Run();
  RegistrationFile Read() const;
  void WriteMerged(const std::vector<StoredRegistration>& changed);

  const std::filesystem::path path_;  // empty: none
  const std::chrono::milliseconds save_delay_;

  std::mutex file_mutex_;  // held while the file is written; taken before mutex_
  std::string last_failure_;

  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable changed_;
  std::vector<StoredRegistration> entries_;  // oldest first
  std::set<std::string> unsaved_;            // their sources
  bool dirty_ = false;                       // since the thread looked last
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace palpate
