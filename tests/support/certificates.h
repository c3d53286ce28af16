// A folder of certificates for a test, made by the openssl program.
#pragma once

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cstdlib>
#include <fstream>
#include <string>

#include "tests/support/temporary_folder.h"

namespace palpate::test {

class Certificates {
 public:
  std::filesystem::path In(const std::string& name) const { return folder_.path() / name; }

  std::string Read(const std::string& name) const { return TextOf(In(name)); }

  void Openssl(const std::string& arguments) const {
    const std::string command =
        "cd " + folder_.path().string() + " && openssl " + arguments + " >/dev/null 2>&1";
    ASSERT_EQ(std::system(command.c_str()), 0) << command;
  }
  // Makes `name`.pem and `name`.key.
  void MakeAuthority(const std::string& name) const {
    Openssl("req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 30 -keyout " +
            name + ".key -out " + name + ".pem -subj /CN=" + name);
  }
  // Makes `name`.pem and `name`.key. -1 day: expired.
  void Issue(const std::string& authority, const std::string& name, const std::string& san,
             int days = 10, const std::string& purpose = "clientAuth,serverAuth") const {
    std::ofstream(In("ext")) << (san.empty() ? "" : "subjectAltName=" + san + "\n")
                             << "extendedKeyUsage=" << purpose << "\n";
    Openssl("req -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -keyout " + name +
            ".key -out csr -subj /CN=" + name);
    Openssl("x509 -req -in csr -CA " + authority + ".pem -CAkey " + authority +
            ".key -CAcreateserial -extfile ext -out " + name + ".pem -days " +
            std::to_string(days));
    chmod(In(name + ".key").c_str(), 0600);
  }

 private:
  TemporaryFolder folder_;
};

}  // namespace palpate::test
