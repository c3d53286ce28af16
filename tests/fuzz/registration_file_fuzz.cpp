// Any bytes as the file of registrations, and each entry as a place for its volume.
#include "server/state/registration_file.h"

#include "common/error/error.h"
#include "server/scene/registration.h"
#include "tests/fuzz/scratch_file.h"

namespace palpate::fuzz {
namespace {

void Put(const StoredRegistration& entry) {
  VolumeMetadata volume;
  volume.size = entry.size.cwiseMax(2);
  volume.spacing_mm = entry.spacing_mm;
  try {
    const Registration registration =
        MakeRegistration(volume, entry.p_DCenter_mm, entry.R_DW, entry.device_mm_per_volume_mm);
    FUZZ_CHECK(registration.X_DW.linear.allFinite() && registration.X_DW.translation.allFinite());
    FUZZ_CHECK(registration.X_DW.Inverse().linear.allFinite());
  } catch (const Error&) {
  }
}

}  // namespace
}  // namespace palpate::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  static const fuzz::ScratchFile file("registrations.toml");
  file.Write({data, size});
  const RegistrationFile read = ReadRegistrations(file.path());
  FUZZ_CHECK(read.damage.find('\n') == std::string::npos);
  for (const StoredRegistration& entry : read.entries) fuzz::Put(entry);
  WriteRegistrations(file.path(), read.entries);
  const std::string once = file.Read();
  const RegistrationFile again = ReadRegistrations(file.path());
  FUZZ_CHECK(again.damage.empty() && again.entries.size() == read.entries.size());
  WriteRegistrations(file.path(), again.entries);
  FUZZ_CHECK(file.Read() == once);
  return 0;
}
