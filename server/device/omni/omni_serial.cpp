#include "server/device/omni/omni_serial.h"

#include <fmt/core.h>

namespace palpate {

std::string OmniSerialOf(std::uint64_t guid) {
  const auto bits = [&](int lowest, int count) { return guid >> lowest & ((1u << count) - 1); };
  return fmt::format("{}{:02}{:02}{}{:05}", bits(23, 3), bits(19, 4), bits(14, 5), bits(11, 3),
                     bits(1, 10));
}

}  // namespace palpate
