#include "client/cli/invocation.h"

namespace palpate::cli {

void SetFooter(arguments::Command& command, const std::string& examples) {
  command.footer(
      examples +
      "\nWhich palpated: --profile NAME, --socket PATH or --server HOST:PORT, see palpate --help");
}

void AddJson(arguments::Command& command, Invocation& invocation) {
  command.add_flag("--json", invocation.json, "One JSON object instead of text");
}

arguments::Option* AddTriple(arguments::Command& command, const std::string& name,
                             std::vector<double>& values, const std::string& about) {
  return command.add_option(name, values, about)
      ->delimiter(',')
      ->expected(3)
      ->check(arguments::Finite())
      ->option_text("X,Y,Z");
}

}  // namespace palpate::cli
