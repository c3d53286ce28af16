#include "tests/support/usb_port.h"

#include <fcntl.h>
#include <linux/usbdevice_fs.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <stdexcept>

namespace palpate::test {
namespace {

constexpr std::size_t kSetupBytes = 8;
constexpr std::uint8_t kIn = 0x80;

UsbSetup ReadSetup(std::span<const std::uint8_t> bytes) {
  const auto word = [&](std::size_t at) {
    return static_cast<std::uint16_t>(bytes[at] | bytes[at + 1] << 8);
  };
  return {.request_type = bytes[0],
          .request = bytes[1],
          .value = word(2),
          .index = word(4),
          .length = word(6)};
}

}  // namespace

usbdevfs_urb& UsbPort::Urb::fields() const { return *reinterpret_cast<usbdevfs_urb*>(data->data); }

std::span<std::uint8_t> UsbPort::Urb::bytes() const {
  if (!buffer) return {};
  return {buffer->data, static_cast<std::size_t>(buffer->data_len)};
}

UsbPort::UsbPort(EmulatedUsbDevice& device, const std::string& node, bool may_open)
    : device_(device), node_(node) {
  for (const UsbInterfaceSpec& part : device.spec().interfaces) {
    drivers_.push_back(part.kernel_driver);
  }
  if (mkfifo(node.c_str(), 0600) != 0) throw std::runtime_error("cannot make " + node);
  pipe_ = open(node.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
  if (pipe_ < 0 || fcntl(pipe_, F_SETPIPE_SZ, 4096) < 0) {
    throw std::runtime_error("cannot use " + node);
  }
  chmod(node.c_str(), 0666);
  if (!may_open && (unlink(node.c_str()) != 0 || symlink(kForbidden, node.c_str()) != 0)) {
    throw std::runtime_error("cannot forbid " + node);
  }
  const std::scoped_lock lock(device_.mutex_);
  device_.in_.clear();
  device_.stalls_.clear();
  SetNode();
  device_.OnPlugged();
}

UsbPort::~UsbPort() {
  Drop(under_way_, nullptr);
  Drop(ended_, nullptr);
  close(pipe_);
}

void UsbPort::Closed(UMockdevIoctlClient* client) {
  const std::scoped_lock lock(device_.mutex_);
  Drop(under_way_, client);
  Drop(ended_, client);
  SetNode();
  if (clients_.erase(client) == 0) return;
  claimed_.clear();
  if (!gone_) device_.Log(UsbEvent::Kind::kClose);
}

void UsbPort::Pull() {
  const std::scoped_lock lock(device_.mutex_);
  gone_ = true;
  while (!under_way_.empty()) {
    Finish(under_way_.front(), -ESHUTDOWN, 0);
    ended_.splice(ended_.end(), under_way_, under_way_.begin());
  }
  SetNode();
  unlink(node_.c_str());
}

void UsbPort::Millisecond() {
  const std::scoped_lock lock(device_.mutex_);
  if (gone_) return;
  device_.OnMillisecond();
  Progress();
}

void UsbPort::HandleIoctl(UMockdevIoctlClient* client) {
  int error = 0;
  {
    const std::scoped_lock lock(device_.mutex_);
    error = Answer(client);
    Progress();
  }
  umockdev_ioctl_client_complete(client, error == 0 ? 0 : -1, error);
}

int UsbPort::Answer(UMockdevIoctlClient* client) {
  const unsigned long request = umockdev_ioctl_client_get_request(client);
  if (request == USBDEVFS_REAPURBNDELAY) return Reap(client);
  if (gone_) {
    if (request == USBDEVFS_SUBMITURB) LogLateOut(client);
    return ENODEV;
  }
  // Not when it connects: umockdev does that for an open that fails, too.
  if (clients_.insert(client).second) device_.Log(UsbEvent::Kind::kOpen);
  switch (request) {
    case USBDEVFS_GET_CAPABILITIES:
      SetArgument<std::uint32_t>(client, USBDEVFS_CAP_ZERO_PACKET | USBDEVFS_CAP_BULK_CONTINUATION |
                                             USBDEVFS_CAP_NO_PACKET_SIZE_LIM |
                                             USBDEVFS_CAP_BULK_SCATTER_GATHER |
                                             USBDEVFS_CAP_REAP_AFTER_DISCONNECT);
      return 0;
    case USBDEVFS_SUBMITURB:
      return Submit(client);
    case USBDEVFS_DISCARDURB:
      return Discard(client);
    case USBDEVFS_CLAIMINTERFACE:
      return Claim(static_cast<std::uint8_t>(ArgumentValue<unsigned>(client)));
    case USBDEVFS_RELEASEINTERFACE: {
      const auto number = static_cast<std::uint8_t>(ArgumentValue<unsigned>(client));
      if (claimed_.erase(number) == 0) return EINVAL;
      device_.Log(UsbEvent::Kind::kRelease, number);
      return 0;
    }
    case USBDEVFS_GETDRIVER:
      return TellDriver(client);
    case USBDEVFS_IOCTL: {
      const auto inner = ArgumentValue<usbdevfs_ioctl>(client);
      const auto code = static_cast<unsigned>(inner.ioctl_code);
      if (code != USBDEVFS_DISCONNECT && code != USBDEVFS_CONNECT) return ENOTTY;
      return BindDriver(static_cast<std::uint8_t>(inner.ifno), code == USBDEVFS_CONNECT);
    }
    case USBDEVFS_CLEAR_HALT: {
      const auto endpoint = static_cast<std::uint8_t>(ArgumentValue<unsigned>(client));
      device_.Log(UsbEvent::Kind::kClearHalt, endpoint);
      const auto stall = device_.stalls_.find(endpoint);
      if (stall != device_.stalls_.end() && !stall->second) device_.stalls_.erase(stall);
      return 0;
    }
    case USBDEVFS_RESET:
    case USBDEVFS_SETCONFIGURATION:
    case USBDEVFS_SETINTERFACE:
    case USBDEVFS_RESETEP:
      return 0;
    default:
      return ENOTTY;
  }
}

int UsbPort::Submit(UMockdevIoctlClient* client) {
  Urb urb{.client = client, .data = Argument(client, sizeof(usbdevfs_urb))};
  if (!urb.data) return EFAULT;
  const usbdevfs_urb& fields = urb.fields();
  if (fields.type == USBDEVFS_URB_TYPE_ISO) {
    umockdev_ioctl_data_unref(urb.data);
    return EINVAL;
  }
  if (fields.buffer_length > 0) {
    urb.buffer =
        umockdev_ioctl_data_resolve(urb.data, offsetof(usbdevfs_urb, buffer),
                                    static_cast<std::size_t>(fields.buffer_length), nullptr);
  }
  under_way_.push_back(urb);
  return 0;
}

void UsbPort::LogLateOut(UMockdevIoctlClient* client) {
  Submit(client);
  if (under_way_.empty()) return;
  const Urb& urb = under_way_.back();
  if (urb.fields().type != USBDEVFS_URB_TYPE_CONTROL && !(urb.fields().endpoint & kIn)) {
    device_.Log(UsbEvent::Kind::kLateOut, urb.fields().endpoint, urb.bytes());
  }
  Drop(under_way_, nullptr);
}

int UsbPort::Reap(UMockdevIoctlClient* client) {
  const auto urb = std::find_if(ended_.begin(), ended_.end(),
                                [&](const Urb& one) { return one.client == client; });
  if (urb == ended_.end()) return gone_ ? ENODEV : EAGAIN;
  UMockdevIoctlData* pointer = Argument(client, sizeof(void*));
  if (!pointer) return EFAULT;
  umockdev_ioctl_data_set_ptr(pointer, 0, urb->data);
  umockdev_ioctl_data_unref(pointer);
  if (urb->buffer) umockdev_ioctl_data_unref(urb->buffer);
  umockdev_ioctl_data_unref(urb->data);
  ended_.erase(urb);
  SetNode();
  return 0;
}

int UsbPort::Discard(UMockdevIoctlClient* client) {
  const UMockdevIoctlData* argument = umockdev_ioctl_client_get_arg(client);
  gulong address = 0;
  std::memcpy(&address, argument->data, sizeof(address));
  const auto urb = std::find_if(under_way_.begin(), under_way_.end(), [&](const Urb& one) {
    return one.client == client && one.data->client_addr == address;
  });
  if (urb == under_way_.end()) return EINVAL;
  Finish(*urb, -ENOENT, 0);
  ended_.splice(ended_.end(), under_way_, urb);
  SetNode();
  return 0;
}

int UsbPort::Claim(std::uint8_t number) {
  if (number >= drivers_.size()) return EINVAL;
  if (device_.faults_.busy || !drivers_[number].empty()) return EBUSY;
  claimed_.insert(number);
  device_.Log(UsbEvent::Kind::kClaim, number);
  return 0;
}

// A driver of several interfaces (CDC-ACM) leaves and takes all of them.
int UsbPort::BindDriver(std::uint8_t number, bool bind) {
  if (number >= drivers_.size()) return EINVAL;
  if (!bind && drivers_[number].empty()) return ENODATA;
  const std::vector<UsbInterfaceSpec>& parts = device_.spec().interfaces;
  const std::string& name = parts[number].kernel_driver;
  for (std::uint8_t n = 0; bind && n < drivers_.size(); ++n) {
    if (parts[n].kernel_driver == name && claimed_.contains(n)) return EBUSY;
  }
  for (std::uint8_t n = 0; n < drivers_.size(); ++n) {
    if (parts[n].kernel_driver == name) drivers_[n] = bind ? name : "";
  }
  device_.Log(bind ? UsbEvent::Kind::kAttachDriver : UsbEvent::Kind::kDetachDriver, number);
  return 0;
}

int UsbPort::TellDriver(UMockdevIoctlClient* client) {
  auto answer = ArgumentValue<usbdevfs_getdriver>(client);
  if (answer.interface >= drivers_.size()) return EINVAL;
  const std::string name = claimed_.contains(static_cast<std::uint8_t>(answer.interface))
                               ? "usbfs"
                               : drivers_[answer.interface];
  if (name.empty()) return ENODATA;
  std::strncpy(answer.driver, name.c_str(), sizeof(answer.driver) - 1);
  SetArgument(client, answer);
  return 0;
}

void UsbPort::Progress() {
  for (auto urb = under_way_.begin(); urb != under_way_.end();) {
    const auto next = std::next(urb);
    if (TryEnd(*urb)) ended_.splice(ended_.end(), under_way_, urb);
    urb = next;
  }
  SetNode();
}

bool UsbPort::TryEnd(Urb& urb) {
  if (urb.fields().type == USBDEVFS_URB_TYPE_CONTROL) {
    EndControl(urb);
    return true;
  }
  if (device_.IsStalled(urb.fields().endpoint)) {
    Finish(urb, -EPIPE, 0);
    return true;
  }
  if (urb.fields().endpoint & kIn) return TryEndIn(urb);
  if (!device_.Out(urb.fields().endpoint, urb.bytes())) return false;
  Finish(urb, 0, urb.bytes().size());
  return true;
}

void UsbPort::EndControl(Urb& urb) {
  const std::span<std::uint8_t> bytes = urb.bytes();
  if (bytes.size() < kSetupBytes) return Finish(urb, -EINVAL, 0);
  const std::span<std::uint8_t> data = bytes.subspan(kSetupBytes);
  const auto answered = device_.Control(ReadSetup(bytes), data);
  if (!answered) return Finish(urb, -EPIPE, 0);
  Finish(urb, 0, std::min(*answered, data.size()));
}

bool UsbPort::TryEndIn(Urb& urb) {
  const auto packet = device_.TakeIn(urb.fields().endpoint);
  if (!packet) return false;
  const std::span<std::uint8_t> bytes = urb.bytes();
  const std::size_t count = std::min(packet->size(), bytes.size());
  std::copy_n(packet->begin(), count, bytes.begin());
  Finish(urb, count < packet->size() ? -EOVERFLOW : 0, count);
  return true;
}

void UsbPort::Finish(Urb& urb, int status, std::size_t actual_bytes) {
  urb.fields().status = status;
  urb.fields().actual_length = static_cast<int>(actual_bytes);
}

void UsbPort::SetNode() {
  const bool full = ended_.empty();
  if (full == pipe_full_) return;
  char byte = 0;
  if ((full ? write(pipe_, &byte, 1) : read(pipe_, &byte, 1)) == 1) pipe_full_ = full;
}

void UsbPort::Drop(std::list<Urb>& urbs, UMockdevIoctlClient* client) {
  urbs.remove_if([&](const Urb& urb) {
    if (client && urb.client != client) return false;
    if (urb.buffer) umockdev_ioctl_data_unref(urb.buffer);
    umockdev_ioctl_data_unref(urb.data);
    return true;
  });
}

}  // namespace palpate::test
