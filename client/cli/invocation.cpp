#include "client/cli/invocation.h"

namespace palpate::cli {

void SetFooter(arguments::Command& command, const std::string& examples) {
  command.footer(
      examples +
      "\nWhich palpated: --profile NAME, --socket PATH or --server HOST:PORT, see palpate --help");
}

}  // namespace palpate::cli
