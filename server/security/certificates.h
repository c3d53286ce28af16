// Certificates: the daemon's own pair, checked before it is used, and the clients'.
//
// Time is the system clock's, as certificates have it.
// Threads: any. Errors: Error that names the file and what to do.
#pragma once

#include <chrono>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

struct x509_store_st;

namespace palpate {

using CertificateTime = std::chrono::system_clock::time_point;

struct CheckedPair {
  std::string pem{};      // the key, then the certificate and what follows it in its file
  std::string subject{};  // for the log
  CertificateTime valid_until{};
};

// The pair, if TLS would work with it: both parse, belong together, are valid at `now`,
// and the key is readable by its owner and group alone.
CheckedPair CheckPair(const std::filesystem::path& certificate, const std::filesystem::path& key,
                      CertificateTime now);

// What is wrong with one of the two alone: for those who want to know all that is wrong.
void CheckKey(const std::filesystem::path& key);
void CheckCertificate(const std::filesystem::path& certificate, CertificateTime now);

// Verifies clients' certificates against the authority of a file.
class ClientAuthority {
 public:
  struct Verdict {
    std::string problem{};             // empty: good
    std::vector<std::string> names{};  // DNS names, URIs and mail addresses it was issued to
    CertificateTime valid_until{};     // of the whole chain
  };

  // Throws for a file without a certificate.
  explicit ClientAuthority(const std::filesystem::path& ca_file);

  // `chain_pem`: the client's certificate, and those between it and the authority. That
  // the client has its key was TLS's to prove. Verified once; then remembered until one
  // of the chain ends.
  Verdict Check(const std::string& chain_pem, CertificateTime now) const;

 private:
  Verdict Verify(const std::string& chain_pem, CertificateTime now) const;

  std::shared_ptr<x509_store_st> store_;
  mutable std::mutex mutex_;
  mutable std::map<std::string, Verdict> verified_;
};

}  // namespace palpate
