// Any bytes as a file that the daemon keeps: which u8 (session, registrations, tokens), file. What
// is read is written and read again without a difference.
#include "common/error/error.h"
#include "server/felt/registration.h"
#include "server/kept/registration_file.h"
#include "server/kept/session_file.h"
#include "server/security/token.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/fuzz/scratch_file.h"

namespace palpate::fuzz {
namespace {

// read(): what the file says; write(it) replaces the file.
template <typename Read, typename Write>
void CheckThatItComesBack(const ScratchFile& file, Read read, Write write) {
  write(read());
  const std::string once = file.Read();
  write(read());
  FUZZ_CHECK(file.Read() == once);
}

void ReadSession(const ScratchFile& file) {
  const SessionFile session = ReadSessionFile(file.path());
  FUZZ_CHECK(session.session.has_value() == session.damage.empty());
  FUZZ_CHECK(session.damage.find('\n') == std::string::npos);
  if (!session.session) return;
  CheckThatItComesBack(
      file, [&] { return ReadSessionFile(file.path()).session.value(); },
      [&](const auto& read) { WriteSessionFile(file.path(), read); });
}

// As a place for its volume.
void CheckRegistration(const StoredRegistration& entry) {
  VolumeMetadata volume;
  volume.size = entry.size.cwiseMax(2);
  volume.spacing_mm = entry.spacing_mm;
  try {
    const VolumePlace registration =
        MakeVolumePlace(volume, entry.p_DCenter_mm, entry.R_DW, entry.device_mm_per_volume_mm);
    FUZZ_CHECK(registration.X_DW.linear.allFinite() && registration.X_DW.translation.allFinite());
    FUZZ_CHECK(registration.X_DW.Inverse().linear.allFinite());
  } catch (const Error&) {
  }
}

void ReadRegistrationFile(const ScratchFile& file) {
  const RegistrationFile first = ReadRegistrations(file.path());
  FUZZ_CHECK(first.damage.find('\n') == std::string::npos);
  for (const StoredRegistration& entry : first.entries) CheckRegistration(entry);
  CheckThatItComesBack(
      file, [&] { return ReadRegistrations(file.path()); },
      [&](const auto& read) { WriteRegistrations(file.path(), read.entries, read.axes); });
  const RegistrationFile again = ReadRegistrations(file.path());
  FUZZ_CHECK(again.damage.empty() && again.entries.size() == first.entries.size() &&
             again.axes.size() == first.axes.size());
}

// Nobody's token is anybody's.
void ReadTokens(const ScratchFile& file) {
  FUZZ_CHECK(!FindToken(ReadTokenFile(file.path()), "palpate_nobodys"));
  const std::size_t count = ReadTokenFile(file.path()).size();
  CheckThatItComesBack(
      file, [&] { return ReadTokenFile(file.path()); },
      [&](const auto& tokens) { WriteTokenFile(file.path(), tokens); });
  FUZZ_CHECK(ReadTokenFile(file.path()).size() == count);
}

}  // namespace
}  // namespace palpate::fuzz

FUZZ_TARGET(state_file_fuzz) {
  using namespace palpate;
  static const fuzz::ScratchFile file("state.toml");
  fuzz::Input input({data, size});
  const int which = input.Take<std::uint8_t>() % 3;
  file.Write(input.TakeRest());
  try {
    if (which == 0) fuzz::ReadSession(file);
    if (which == 1) fuzz::ReadRegistrationFile(file);
    if (which == 2) fuzz::ReadTokens(file);
  } catch (const Error&) {
    FUZZ_CHECK(which == 2);  // Damage of the other two is said otherwise.
  }
  return 0;
}
