// Any bytes as the file of tokens. What is read is written and read again without a
// difference, and nobody's token is anybody's.
#include "server/security/token_file.h"

#include "common/error/error.h"
#include "tests/fuzz/scratch_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  static const fuzz::ScratchFile file("tokens.toml");
  file.Write({data, size});
  try {
    const std::vector<StoredToken> tokens = ReadTokenFile(file.path());
    FUZZ_CHECK(!FindToken(tokens, "palpate_nobodys"));
    WriteTokenFile(file.path(), tokens);
    const std::string once = file.Read();
    const std::vector<StoredToken> again = ReadTokenFile(file.path());
    FUZZ_CHECK(again.size() == tokens.size());
    WriteTokenFile(file.path(), again);
    FUZZ_CHECK(file.Read() == once);
  } catch (const Error&) {
  }
  return 0;
}
