#include "client/cli/invocation.h"

#include <fmt/core.h>

namespace palpate::cli {

CLI::Validator Finite() {
  return CLI::Validator(
      [](const std::string& text) {
        double value = 0.0;
        const bool is_number = CLI::detail::lexical_cast(text, value) && std::isfinite(value);
        return is_number ? std::string() : "'" + text + "' is not a number";
      },
      "");
}

CLI::Validator Positive(double greatest) {
  return CLI::Validator(
      [greatest](const std::string& text) {
        double value = 0.0;
        const bool is_valid = CLI::detail::lexical_cast(text, value) && std::isfinite(value) &&
                              value > 0.0 && value <= greatest;
        return is_valid
                   ? std::string()
                   : "'" + text + "' is not a number above 0" +
                         (std::isfinite(greatest) ? fmt::format(", up to {:g}", greatest) : "");
      },
      "");
}

void SetFooter(CLI::App& command, const std::string& examples) {
  command.footer(examples +
                 "\nWhich palpated: --socket PATH or --server HOST:PORT, see palpate --help");
}

}  // namespace palpate::cli
