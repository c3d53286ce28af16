// Connects, prints the newest pose, and sets the isovalue: example [WHERE [ISOVALUE]]. WHERE is a
// profile of clients.toml, or the path of a socket, with a slash in it.
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>

#include "client/sdk/client.h"

int main(int argc, char** argv) try {
  using namespace std::chrono_literals;
  const std::string where = argc > 1 ? argv[1] : "";
  const bool is_socket = where.find('/') != where.npos;
  palpate::client::Client client(
      {.profile = is_socket ? "" : where, .address = {.socket_path = is_socket ? where : ""}});
  if (!client.WaitUntilConnected(3s)) throw std::runtime_error(client.connection().why);
  while (!client.NewestPose()) std::this_thread::sleep_for(10ms);
  const palpate::client::Pose pose = *client.NewestPose();
  std::printf("tick %llu: tip at %.1f %.1f %.1f mm, %.2f N\n",
              static_cast<unsigned long long>(pose.tick), pose.hip_mm.x(), pose.hip_mm.y(),
              pose.hip_mm.z(), pose.force_n.norm());
  const double isovalue = argc > 2 ? std::atof(argv[2]) : client.GetSettings().isovalue;
  const auto set = client.Set({.isovalue = isovalue});
  std::printf("isovalue %g from tick %llu on\n", set.settings.isovalue,
              static_cast<unsigned long long>(set.applied_tick));
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
