#include "server/device/omni/omni_usb_protocol.h"

#include "server/device/omni/cdc_line.h"
#include "server/device/omni/omni_arm.h"
#include "server/device/omni/omni_usb_identity.h"

namespace palpate {
namespace {

constexpr UsbMatch::Ids kHidTouch{0x2988, 0x0304};

// A process that was killed can leave the device unable to answer. A break has repaired that.
std::string Identify(UsbLink& link, const std::atomic<bool>& stop) {
  CdcLine line(link);
  line.Open();
  try {
    return AskOmniUsbIdentity(link, stop);
  } catch (const BusError& error) {
    if (error.fault() != BusFault::kTimeout || stop) throw;
  }
  line.Break();
  return AskOmniUsbIdentity(link, stop);
}

}  // namespace

DeviceDescription OmniUsbSpec() {
  DeviceDescription spec = OmniArmSpec();
  spec.kind = "omni-usb";
  spec.model = "Phantom Omni / Geomagic Touch (USB)";
  spec.verification_level = kOmniUsbVerification;
  return spec;
}

const std::vector<UsbMatch::Ids>& OmniUsbIds() {
  static const std::vector<UsbMatch::Ids> ids = {{0x2988, 0x0302}, kHidTouch, {0x0301, 0x2988}};
  return ids;
}

std::string OmniUsbProblem(const UsbMatch::Ids& ids) {
  return ids == kHidTouch
             ? "it is a Touch that speaks HID; its reports are not public: use it through "
               "the vendor's driver, or see deploy/guides/devices.md to capture them"
             : "";
}

OmniUsbProtocol::OmniUsbProtocol(const std::string& port) : spec_(OmniUsbSpec()) {
  match_.ids = OmniUsbIds();
  match_.port = port;
  match_.data_class = kCdcDataClass;
  match_.problem_of = OmniUsbProblem;
}

std::string OmniUsbProtocol::SetUp(UsbLink& link, const std::atomic<bool>& stop) {
  throw BusError(BusFault::kUnsuitable,
                 "on USB port " + link.found().port + " is " + Identify(link, stop) +
                     "; its servo frames over USB are not public: use it through the vendor's "
                     "driver (`openhaptics`), or see deploy/guides/devices.md to capture them");
}

}  // namespace palpate
