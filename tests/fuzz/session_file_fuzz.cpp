// Any bytes as the file of a session that a daemon left behind. What is read is written
// and read again without a difference.
#include "server/state/session_file.h"

#include "tests/fuzz/scratch_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  static const fuzz::ScratchFile file("session.toml");
  file.Write({data, size});
  const SessionFile read = ReadSessionFile(file.path());
  FUZZ_CHECK(read.session.has_value() == read.damage.empty());
  FUZZ_CHECK(read.damage.find('\n') == std::string::npos);
  if (!read.session) return 0;
  WriteSessionFile(file.path(), *read.session);
  const std::string once = file.Read();
  const SessionFile again = ReadSessionFile(file.path());
  FUZZ_CHECK(again.session);
  WriteSessionFile(file.path(), *again.session);
  FUZZ_CHECK(file.Read() == once);
  return 0;
}
