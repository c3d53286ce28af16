// usb_client_child ACTION: a plain libusb program, to show what an emulated device
// does to one. Says what it does, a line each.
//
//   list           every device: port, ids
//   watch          arrivals and departures, until it is ended
//   touch COUNT    sets the emulated Touch up and answers COUNT states with a force
//
// Exits with 0, or 1 after a line that names libusb's error.
#include <libusb.h>
#include <sys/resource.h>
#include <time.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

namespace {

constexpr unsigned kTimeoutMs = 2000;
constexpr unsigned char kDataIn = 0x82, kDataOut = 0x03;

void Say(const std::string& line) {
  std::printf("%s\n", line.c_str());
  std::fflush(stdout);
}

int Check(int result, const char* what) {
  if (result >= 0) return result;
  Say(std::string(what) + ": " + libusb_error_name(result));
  std::exit(1);
}

std::string Name(libusb_device* device) {
  libusb_device_descriptor descriptor{};
  libusb_get_device_descriptor(device, &descriptor);
  unsigned char ports[8] = {};
  const int depth = libusb_get_port_numbers(device, ports, sizeof(ports));
  std::string name = std::to_string(libusb_get_bus_number(device));
  for (int n = 0; n < depth; ++n) name += (n == 0 ? '-' : '.') + std::to_string(ports[n]);
  char ids[16];
  std::snprintf(ids, sizeof(ids), " %04x:%04x", descriptor.idVendor, descriptor.idProduct);
  return name + ids;
}

void List(libusb_context* usb) {
  libusb_device** devices = nullptr;
  const ssize_t count = libusb_get_device_list(usb, &devices);
  for (ssize_t n = 0; n < count; ++n) Say(Name(devices[n]));
  libusb_free_device_list(devices, 1);
}

int LIBUSB_CALL OnHotplug(libusb_context*, libusb_device* device, libusb_hotplug_event event,
                          void*) {
  Say((event == LIBUSB_HOTPLUG_EVENT_DEVICE_ARRIVED ? "arrived " : "left ") + Name(device));
  return 0;
}

void Watch(libusb_context* usb) {
  Check(libusb_hotplug_register_callback(
            usb, LIBUSB_HOTPLUG_EVENT_DEVICE_ARRIVED | LIBUSB_HOTPLUG_EVENT_DEVICE_LEFT,
            LIBUSB_HOTPLUG_NO_FLAGS, LIBUSB_HOTPLUG_MATCH_ANY, LIBUSB_HOTPLUG_MATCH_ANY,
            LIBUSB_HOTPLUG_MATCH_ANY, OnHotplug, nullptr, nullptr),
        "hotplug");
  Say("watching");
  for (;;) libusb_handle_events(usb);
}

void Send(libusb_device_handle* handle, std::vector<unsigned char> bytes) {
  int sent = 0;
  Check(libusb_bulk_transfer(handle, kDataOut, bytes.data(), static_cast<int>(bytes.size()), &sent,
                             kTimeoutMs),
        "send");
}

// A query's answer, as text after its head.
std::string Ask(libusb_device_handle* handle, std::vector<unsigned char> query) {
  Send(handle, std::move(query));
  unsigned char answer[512] = {};
  int count = 0;
  Check(libusb_bulk_transfer(handle, kDataIn, answer, sizeof(answer), &count, kTimeoutMs),
        "answer");
  return reinterpret_cast<char*>(answer) + 4;
}

// States come, each is answered with a force that is zero.
class Exchange {
 public:
  Exchange(libusb_context* usb, libusb_device_handle* handle, int count)
      : usb_(usb), handle_(handle), left_(count) {
    force_ = {0xa5, 0x5a, 0x22, 16, 0xff, 0x07, 0xff, 0x07, 0xff, 0x07, 0xc0, 0x53};
    force_.resize(20);
    in_ = libusb_alloc_transfer(0);
    out_ = libusb_alloc_transfer(0);
    libusb_fill_bulk_transfer(in_, handle_, kDataIn, state_, sizeof(state_), OnState, this, 0);
    libusb_fill_bulk_transfer(out_, handle_, kDataOut, force_.data(),
                              static_cast<int>(force_.size()), OnForce, this, 0);
  }
  ~Exchange() {
    libusb_free_transfer(in_);
    libusb_free_transfer(out_);
  }

  void Run() {
    Check(libusb_submit_transfer(in_), "submit");
    int passes = 0;
    while (left_ > 0 || out_busy_) {
      timeval longest{2, 0};
      libusb_handle_events_timeout_completed(usb_, &longest, nullptr);
      ++passes;
      if (stalled_) Recover();
    }
    Say("passes " + std::to_string(passes));
  }

 private:
  static void LIBUSB_CALL OnState(libusb_transfer* transfer) {
    Exchange& self = *static_cast<Exchange*>(transfer->user_data);
    if (!self.Judge(transfer, "state")) return;
    if (transfer->actual_length != 48) Say("short " + std::to_string(transfer->actual_length));
    if (self.left_ > 0) --self.left_;
    if (!self.out_busy_ && libusb_submit_transfer(self.out_) == 0) self.out_busy_ = true;
    if (self.left_ > 0) Check(libusb_submit_transfer(transfer), "submit");
  }

  static void LIBUSB_CALL OnForce(libusb_transfer* transfer) {
    Exchange& self = *static_cast<Exchange*>(transfer->user_data);
    self.out_busy_ = false;
    self.Judge(transfer, "force");
  }

  bool Judge(const libusb_transfer* transfer, const char* what) {
    if (transfer->status == LIBUSB_TRANSFER_COMPLETED) return true;
    if (transfer->status == LIBUSB_TRANSFER_STALL) {
      Say(std::string("stall ") + what);
      stalled_ = true;
      return false;
    }
    Say(std::string(what) +
        (transfer->status == LIBUSB_TRANSFER_NO_DEVICE ? ": gone" : ": another error"));
    std::exit(1);
  }

  // Not in a callback: clearing waits.
  void Recover() {
    stalled_ = false;
    Check(libusb_clear_halt(handle_, kDataIn), "clear");
    Check(libusb_submit_transfer(in_), "submit");
    Say("recovered");
  }

  libusb_context* usb_;
  libusb_device_handle* handle_;
  int left_;
  libusb_transfer *in_, *out_;
  unsigned char state_[512] = {};
  std::vector<unsigned char> force_;
  bool out_busy_ = false, stalled_ = false;
};

double ProcessorMs() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto ms = [](const timeval& time) {
    return 1e3 * static_cast<double>(time.tv_sec) + 1e-3 * static_cast<double>(time.tv_usec);
  };
  return ms(usage.ru_utime) + ms(usage.ru_stime);
}

double ClockMs() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

void Touch(libusb_context* usb, int count) {
  libusb_device_handle* handle = libusb_open_device_with_vid_pid(usb, 0x2988, 0x0302);
  if (!handle) Check(LIBUSB_ERROR_NO_DEVICE, "open");
  Check(libusb_set_auto_detach_kernel_driver(handle, 1), "driver");
  for (int part : {0, 1}) Check(libusb_claim_interface(handle, part), "claim");
  Say("claimed");
  Check(libusb_control_transfer(handle, 0x21, 0x22, 3, 0, nullptr, 0, kTimeoutMs), "control");
  std::vector<unsigned char> query = {0xa5, 0x5a, 0x0f, 0x20};
  query.resize(36);
  Say("firmware " + Ask(handle, query));
  Say("serial " + Ask(handle, {0xa5, 0x5a, 0x0c, 0x01, 0x00}));
  Send(handle, {0xa5, 0x5a, 0x07, 0x07, 0x01, 0x00, 0x00, 0x80, 0x00, 0x00, 0x00});
  const double processor_ms = ProcessorMs(), start_ms = ClockMs();
  Exchange(usb, handle, count).Run();
  Say("elapsed " + std::to_string(ClockMs() - start_ms) + " ms, processor " +
      std::to_string(ProcessorMs() - processor_ms) + " ms");
  for (int part : {0, 1}) Check(libusb_release_interface(handle, part), "release");
  libusb_close(handle);
}

}  // namespace

int main(int count, char** arguments) {
  if (count < 2) return 2;
  libusb_context* usb = nullptr;
  Check(libusb_init(&usb), "init");
  const std::string action = arguments[1];
  if (action == "list") List(usb);
  if (action == "watch") Watch(usb);
  if (action == "touch" && count == 3) Touch(usb, std::atoi(arguments[2]));
  libusb_exit(usb);
  Say("done");
  return 0;
}
