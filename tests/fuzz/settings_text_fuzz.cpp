// Any text as the settings of a recording.
#include "server/recording/settings_text.h"

#include "server/recording/bytes.h"
#include "tests/fuzz/fuzz_input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  try {
    std::vector<std::string> unknown;
    const std::string text =
        SettingsText(SettingsFromText({reinterpret_cast<const char*>(data), size}, unknown));
    unknown.clear();
    FUZZ_CHECK(SettingsText(SettingsFromText(text, unknown)) == text);
    FUZZ_CHECK(unknown.empty());
  } catch (const DamagedBytes&) {
  }
  return 0;
}
