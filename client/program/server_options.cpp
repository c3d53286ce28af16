#include "client/program/server_options.h"

#include "common/contract/enumerations.h"

namespace palpate::client {

void AddServerOptions(arguments::Command& app, ServerChoice& server) {
  arguments::Option* const profile =
      app.add_option("--profile", server.profile,
                     "A palpated of clients.toml, with all that is needed to reach it")
          ->option_text("NAME");
  const auto add = [&](const char* name, std::string& text, const char* form, const char* about) {
    return app.add_option(name, text, about)->option_text(form)->excludes(profile);
  };
  arguments::Option* const socket =
      add("--socket", server.address.socket_path, "PATH",
          "Unix socket of palpated [default: $PALPATE_SOCKET, else in /run/palpate,\n"
          "$XDG_RUNTIME_DIR/palpate or /tmp/palpate-UID]");
  arguments::Option* const role =
      add("--role", server.address.role, "ROLE",
          "viewer, editor, operator or admin: the socket of this role beside it\n"
          "[default: the highest that you may open]");
  role->suggest({kWords<Role>.begin(), kWords<Role>.end()});
  add("--server", server.address.host_port, "HOST:PORT",
      "Address of a palpated on the network [default: $PALPATE_SERVER]")
      ->excludes(socket)
      ->excludes(role);
  add("--tls-ca", server.credentials.ca_file, "FILE",
      "Certificate authority of a palpated with TLS, PEM; with --server\n"
      "[default: $PALPATE_TLS_CA]");
  add("--tls-cert", server.credentials.certificate_file, "FILE",
      "Our certificate, PEM, with --tls-key");
  add("--tls-key", server.credentials.key_file, "FILE", "Its key, PEM");
  add("--token-file", server.credentials.token_file, "FILE",
      "Holds our token, for TLS only [default: $PALPATE_TOKEN_FILE]");
}

}  // namespace palpate::client
