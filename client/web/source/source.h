// Where what guests see comes from: palpated, or a room of a NATS server. A source puts everything
// new into the hub, which does not know which source it is.
//
// After a loss everything comes back by itself; the hub keeps the last state meanwhile.
//
// Threads: methods on the network thread, unless stated. Errors: none.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "client/web/hub/hub.h"

namespace palpate::web {

// Runs a function on the network thread.
using Post = std::function<void(std::function<void()>)>;

class Source {
 public:
  virtual ~Source() = default;

  // Asks for what is not told by itself. Call it once a second.
  virtual void Poll() = 0;

  // What the hub needs; see its members of the same names. Any thread.
  virtual BlobPtr FindBlob(std::string_view name) const = 0;
  virtual void Steer(const SteerRequest& request, std::function<void(std::string error)> done) = 0;
  virtual std::string Health() const = 0;
  virtual std::string Hello(const std::string& user,
                            const std::vector<std::string>& may_steer) const = 0;

  // For metrics. Any thread.
  // Age of the newest pose [s]; none before the first. Of another machine: since it came.
  virtual std::optional<double> pose_age_s() const = 0;
  virtual bool is_copy_complete() const = 0;
};

}  // namespace palpate::web
