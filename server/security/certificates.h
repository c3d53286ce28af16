// Checks certificates: the daemon's own pair before use, and the clients' certificates.
//
// Times are of the system clock, as in certificates.
// Threads: any. Errors: Error that names the file and what to do.
#pragma once

#include <chrono>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <vector>

struct x509_store_st;

namespace palpate {

using CertificateTime = std::chrono::system_clock::time_point;

struct CheckedPair {
  std::string pem{};      // the key, then all certificates of the certificate's file
  std::string subject{};  // for the log
  CertificateTime valid_until{};
};

// Returns the pair if TLS can use it: both files parse and belong together, the certificate is
// valid at `now`, and only the key's owner and group can read the key.
CheckedPair CheckPair(const std::filesystem::path& certificate, const std::filesystem::path& key,
                      CertificateTime now);

// Check one of the two alone, for callers that report all problems.
void CheckKey(const std::filesystem::path& key);
void CheckCertificate(const std::filesystem::path& certificate, CertificateTime now);

// Verifies clients' certificates against the authority of a file.
class ClientAuthority {
 public:
  // The longest chain that is accepted; common ones have 2 to 8 KiB.
  static constexpr std::size_t kLongestChain = 32 << 10;
  using Chain = std::shared_ptr<const std::string>;  // PEM

  struct Verdict {
    std::string problem{};             // empty: good
    std::vector<std::string> names{};  // the certificate's DNS names, URIs and mail addresses
    CertificateTime valid_until{};     // of the whole chain
    Chain chain{};                     // of a good one: the copy that all who ask share
  };

  // Throws if the file holds no certificate.
  explicit ClientAuthority(const std::filesystem::path& ca_file);

  // `chain`: the client's certificate, and the certificates between it and the authority. TLS has
  // already proved that the client has its key. A good chain is verified once, and remembered until
  // one of its certificates expires. Never waits: while another thread looks into the memory, the
  // chain is verified anew.
  Verdict Check(const Chain& chain, CertificateTime now) const;

 private:
  Verdict Verify(const std::string& chain_pem, CertificateTime now) const;

  std::shared_ptr<x509_store_st> store_;
  mutable std::mutex mutex_;
  mutable std::map<std::string_view, Verdict> verified_;  // by the texts of their chains
};

}  // namespace palpate
