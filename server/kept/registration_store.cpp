#include "server/kept/registration_store.h"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <span>
#include <utility>

#include "common/error/error.h"
#include "common/files/file_lock.h"
#include "common/files/new_file.h"
#include "server/log/log.h"

namespace palpate {
namespace {

// Gives a file one name, however the path to it is written.
std::string Key(const VolumeMetadata& volume) {
  const std::string& source = volume.source;
  return source.starts_with('/') ? std::filesystem::path(source).lexically_normal().string()
                                 : source;
}

bool IsOf(const StoredRegistration& entry, const VolumeMetadata& volume) {
  return entry.size == volume.size && entry.spacing_mm == volume.spacing_mm;
}

constexpr std::chrono::seconds kLockPatience{3};

// Keeps other daemons of the same user from writing the file meanwhile. If the lock cannot be made
// for lack of rights, the file cannot be written either.
FileLock LockBeside(const std::filesystem::path& path) {
  FileLock lock;
  try {
    MakeFolders(path.parent_path());
  } catch (const Error&) {
    return lock;
  }
  if (lock.Take(path.string() + ".lock", LockOf::kFile, kLockPatience) ==
      LockResult::kHeldByAnother) {
    throw Error(ErrorKind::kConflict, "another program holds " + path.string() + ".lock: end it");
  }
  return lock;
}

const std::string& NameOf(const StoredRegistration& entry) { return entry.source; }
const std::string& NameOf(const StoredAxes& entry) { return entry.voxels; }

// Adds the entry as the newest and removes an older one of the same name.
template <class Entry>
void Put(const Entry& entry, std::vector<Entry>& entries) {
  std::erase_if(entries, [&](const auto& other) { return NameOf(other) == NameOf(entry); });
  entries.push_back(entry);
  if (entries.size() > RegistrationStore::kMostEntries) entries.erase(entries.begin());
}

}  // namespace

RegistrationStore::RegistrationStore(std::filesystem::path folder,
                                     std::chrono::milliseconds save_delay)
    : path_(folder.empty() ? std::filesystem::path() : folder / "registrations.toml") {
  if (path_.empty()) return;
  try {
    const RegistrationFile file = Read();
    for (const StoredRegistration& entry : file.entries) Put(entry, entries_);
    for (const StoredAxes& entry : file.axes) Put(entry, axes_);
  } catch (const Error& error) {
    LogWarning("the places of volumes are not known: {}", error.what());
  }
  saver_.emplace("palpate-state", save_delay, [this](bool) { return Save(); });
}

RegistrationStore::~RegistrationStore() {
  saver_.reset();
  Save();
}

std::string RegistrationStore::Await() { return saver_ ? saver_->Await() : std::string(); }

std::optional<VolumePlace> RegistrationStore::Find(const VolumeMetadata& volume) const {
  const std::string key = Key(volume);
  const std::lock_guard lock(mutex_);
  const auto entry = std::find_if(entries_.begin(), entries_.end(),
                                  [&](const auto& other) { return other.source == key; });
  if (entry == entries_.end() || !IsOf(*entry, volume)) return std::nullopt;
  try {
    return MakeVolumePlace(volume, entry->p_DCenter_mm, entry->R_DW,
                           entry->device_mm_per_volume_mm);
  } catch (const Error& error) {
    LogWarning("the saved place of {} is not used: {}", key, error.what());
    return std::nullopt;
  }
}

std::string RegistrationStore::WhyLost(const VolumeMetadata& volume) const {
  const std::string key = Key(volume);
  const std::lock_guard lock(mutex_);
  for (const StoredRegistration& entry : entries_) {
    if (entry.source != key || IsOf(entry, volume)) continue;
    return "the place kept for it was for another volume, " +
           ShapeText(entry.size, entry.spacing_mm) + ": it is placed anew";
  }
  return "";
}

void RegistrationStore::Keep(const VolumeMetadata& volume, const VolumePlace& registration) {
  const StoredRegistration entry{Key(volume),       volume.size,
                                 volume.spacing_mm, registration.p_DCenter_mm,
                                 registration.R_DW, registration.device_mm_per_volume_mm};
  const std::lock_guard lock(mutex_);
  Put(entry, entries_);
  Note(entry.source);
}

std::string RegistrationStore::VoxelsName(const VolumeMetadata& volume, const ContentHash& voxels) {
  std::array<double, 12> shape{};
  for (Eigen::Index n = 0; n < 3; ++n) shape[static_cast<std::size_t>(n)] = volume.size[n];
  // Adding 0 turns a negative zero into a positive one.
  for (Eigen::Index n = 0; n < 9; ++n) {
    shape[static_cast<std::size_t>(3 + n)] = volume.direction(n / 3, n % 3) + 0.0;
  }
  ContentHash name = HashOfBytes(std::byte{0}, std::as_bytes(std::span(shape)));
  name += voxels;
  return fmt::format("{:016x}{:016x}", name.high, name.low);
}

std::string RegistrationStore::FindAxes(const std::string& voxels) const {
  const std::lock_guard lock(mutex_);
  const auto entry = std::find_if(axes_.begin(), axes_.end(),
                                  [&](const auto& other) { return other.voxels == voxels; });
  return entry == axes_.end() ? "" : entry->patient_axes;
}

void RegistrationStore::KeepAxes(const std::string& voxels, const std::string& patient_axes) {
  const std::lock_guard lock(mutex_);
  Put(StoredAxes{voxels, patient_axes}, axes_);
  Note(voxels);
}

// The caller holds mutex_.
void RegistrationStore::Note(const std::string& unsaved) {
  if (path_.empty()) return;
  unsaved_.insert(unsaved);
}

std::string RegistrationStore::Save() {
  const std::lock_guard writing(file_mutex_);
  std::set<std::string> names;
  RegistrationFile changed;
  {
    const std::lock_guard lock(mutex_);
    names.swap(unsaved_);
    saving_ = names;
    const auto is_unsaved = [&](const auto& entry) { return names.contains(NameOf(entry)); };
    std::ranges::copy_if(entries_, std::back_inserter(changed.entries), is_unsaved);
    std::ranges::copy_if(axes_, std::back_inserter(changed.axes), is_unsaved);
  }
  if (changed.entries.empty() && changed.axes.empty()) return {};
  std::string failure;
  try {
    WriteMerged(changed);
  } catch (const std::exception& error) {
    failure = error.what();
  }
  std::string before;
  {
    const std::lock_guard lock(mutex_);
    saving_.clear();
    if (!failure.empty()) unsaved_.merge(names);  // tried again
    before = std::exchange(failure_, failure);
  }
  // A failure is logged once, not at every move.
  if (!failure.empty() && failure != before) {
    LogWarning("the places of volumes are not saved: {}", failure);
  }
  return failure;
}

std::string RegistrationStore::Failure(const VolumeMetadata& volume,
                                       const std::string& voxels) const {
  const std::lock_guard lock(mutex_);
  const auto is_of = [&](const std::set<std::string>& names) {
    return names.contains(Key(volume)) || names.contains(voxels);
  };
  if (!is_of(unsaved_) && !is_of(saving_)) return "";
  return failure_.empty() && saver_ ? saver_->failure() : failure_;
}

// Adds the changes to the file's present entries: another daemon of the same user may have written
// to the file.
void RegistrationStore::WriteMerged(const RegistrationFile& changed) {
  const FileLock lock = LockBeside(path_);
  std::vector<StoredRegistration> entries;
  std::vector<StoredAxes> axes;
  for (const RegistrationFile& file : {Read(), changed}) {
    for (const StoredRegistration& entry : file.entries) Put(entry, entries);
    for (const StoredAxes& entry : file.axes) Put(entry, axes);
  }
  WriteRegistrations(path_, entries, axes);
}

RegistrationFile RegistrationStore::Read() const {
  RegistrationFile file = ReadRegistrations(path_);
  if (!file.damage.empty()) {
    std::error_code error;
    const std::filesystem::path aside = path_.string() + ".damaged";
    std::filesystem::rename(path_, aside, error);
    LogWarning("{} is damaged: {}; {}", path_.string(), file.damage,
               error ? "it cannot be set aside: " + error.message()
                     : "it was set aside as " + aside.string());
  }
  return file;
}

}  // namespace palpate
