// Enumerations of the client library have the numbers of the contract; 0 means unknown.
#pragma once

namespace palpate::client {

template <typename Enum>
Enum EnumOf(int value, Enum last) {
  return value < 0 || value > static_cast<int>(last) ? Enum{} : static_cast<Enum>(value);
}

}  // namespace palpate::client
