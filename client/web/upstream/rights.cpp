#include "client/web/upstream/rights.h"

namespace palpate::web {

std::string RightsWarning(client::Role role, bool steers) {
  const client::Role needed = steers ? client::Role::kEditor : client::Role::kViewer;
  if (role <= needed) return "";
  const std::string word = steers ? "editor" : "viewer";
  return "warning: palpated lets this gateway do more than the " + word +
         " that it needs to be: connect it by palpated's socket of that role (--role " + word +
         "), or with a token of that role (see the guide 'Guests in a browser')";
}

}  // namespace palpate::web
