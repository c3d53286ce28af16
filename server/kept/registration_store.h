// Remembers the places of volumes and where patients face in them, also after a restart of the
// daemon.
//
// Keeps them in memory. If a folder is given, saves them in its registrations.toml: a thread of its
// own saves once a second what has changed, or at once if a caller waits for it, and the destructor
// saves the rest. A damaged file is set aside as registrations.toml.damaged. Damage and failures to
// write are logged; neither stops anything. A failed write is tried again.
//
// Threads: any ordinary thread; Keep and Find do not touch the disk.
// Ownership: owns its thread.
#pragma once

#include <chrono>
#include <filesystem>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "common/bricks/brick.h"
#include "server/felt/registration.h"
#include "server/kept/registration_file.h"
#include "server/kept/saver.h"

namespace palpate {

class RegistrationStore {
 public:
  // Beyond this number the oldest entries are forgotten.
  static constexpr std::size_t kMostEntries = 1000;
  // The time from a change until it is written, together with all other changes of that time.
  static constexpr std::chrono::milliseconds kSaveDelay{1000};

  // `folder` empty: nothing is written.
  explicit RegistrationStore(std::filesystem::path folder,
                             std::chrono::milliseconds save_delay = kSaveDelay);
  ~RegistrationStore();
  RegistrationStore(const RegistrationStore&) = delete;
  RegistrationStore& operator=(const RegistrationStore&) = delete;

  // Finds the place of a volume with this source, size and spacing.
  std::optional<VolumePlace> Find(const VolumeMetadata& volume) const;
  // Says why Find() does not give the place that is kept for this source: it was for another size
  // or spacing. Empty: none is kept, or it fits.
  std::string WhyLost(const VolumeMetadata& volume) const;
  void Keep(const VolumeMetadata& volume, const VolumePlace& registration);

  // Names voxels by their contents and their directions in W, not by their source: a renamed file
  // has the same name, also with another spacing. `voxels`: their content hash as loaded, so this
  // costs next to nothing.
  static std::string VoxelsName(const VolumeMetadata& volume, const ContentHash& voxels);
  // What somebody answered (PatientAxesOf) for voxels of this name; empty: nothing yet.
  std::string FindAxes(const std::string& voxels) const;
  void KeepAxes(const std::string& voxels, const std::string& patient_axes);

  // Writes all unsaved changes now. Returns as Await.
  std::string Save();
  // Waits until all changes are on the disk, for about a second at most. Returns why they are not;
  // empty: they are.
  std::string Await();
  // Why the place or the answer of this volume could not be saved; empty: it was, or there is
  // nothing to save. Does not wait for the disk.
  std::string Failure(const VolumeMetadata& volume, const std::string& voxels = {}) const;

 private:
  RegistrationFile Read() const;
  void Note(const std::string& unsaved);
  void WriteMerged(const RegistrationFile& changed);

  const std::filesystem::path path_;  // empty: nothing is written

  std::mutex file_mutex_;  // held while the file is written; taken before mutex_

  mutable std::mutex mutex_;                 // guards what follows
  std::vector<StoredRegistration> entries_;  // oldest first
  std::vector<StoredAxes> axes_;             // oldest first
  std::set<std::string> unsaved_;            // sources of unsaved entries, names of unsaved answers
  std::set<std::string> saving_;             // those that are being written
  std::string failure_;
  std::optional<Saver> saver_;  // last, so that its thread ends first
};

}  // namespace palpate
