#include "server/security/certificates.h"

#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/ssl.h>
#include <openssl/x509v3.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>

#include "common/error/error.h"

namespace palpate {
namespace {

// The most verified chains that are remembered. If there are more, all are forgotten.
constexpr std::size_t kMostVerified = 256;
constexpr std::size_t kMostFileBytes = 1 << 20;

template <auto kFree>
struct Freer {
  template <class T>
  void operator()(T* object) const {
    kFree(object);
  }
};
using Bio = std::unique_ptr<BIO, Freer<BIO_free>>;
using Certificate = std::unique_ptr<X509, Freer<X509_free>>;
using Key = std::unique_ptr<EVP_PKEY, Freer<EVP_PKEY_free>>;
using TlsContext = std::unique_ptr<SSL_CTX, Freer<SSL_CTX_free>>;

void FreeStack(STACK_OF(X509) * stack) { sk_X509_pop_free(stack, X509_free); }
void FreeNames(GENERAL_NAMES* names) { GENERAL_NAMES_free(names); }

std::string ReadFile(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::string text(kMostFileBytes, '\0');
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(file.gcount()));
  if (text.empty()) {
    throw Error(ErrorKind::kNotFound, "cannot read " + path.string() +
                                          ", or it is empty: correct the path, or who may read it");
  }
  return text;
}

Bio Reader(const std::string& text) {
  return Bio(BIO_new_mem_buf(text.data(), static_cast<int>(text.size())));
}

std::vector<Certificate> ParseCertificates(const std::string& pem) {
  std::vector<Certificate> all;
  const Bio reader = Reader(pem);
  while (X509* one = PEM_read_bio_X509(reader.get(), nullptr, nullptr, nullptr)) {
    all.emplace_back(one);
  }
  // The end of the file, which ends the loop, is no error.
  ERR_clear_error();
  return all;
}

CertificateTime ToTime(const ASN1_TIME* time) {
  std::tm parts{};
  if (ASN1_TIME_to_tm(time, &parts) != 1) return {};
  return std::chrono::system_clock::from_time_t(timegm(&parts));
}

std::string SubjectOf(X509* certificate) {
  const Bio writer(BIO_new(BIO_s_mem()));
  // Escapes characters that would break a line of the log.
  X509_NAME_print_ex(writer.get(), X509_get_subject_name(certificate), 0, XN_FLAG_ONELINE);
  char* text = nullptr;
  const long length = BIO_get_mem_data(writer.get(), &text);
  return {text, static_cast<std::size_t>(length)};
}

void CheckKeyIsPrivate(const std::filesystem::path& path) {
  struct stat status {};
  if (stat(path.c_str(), &status) != 0) {
    throw Error(ErrorKind::kNotFound, "cannot read " + path.string() + ": " + std::strerror(errno) +
                                          "; correct the path, or who may read it");
  }
  if ((status.st_mode & 027) != 0) {
    throw Error(ErrorKind::kPermissionDenied,
                "the key " + path.string() +
                    " may be read or written by others: 'chmod 640' it, and make a new one where "
                    "others could read it");
  }
}

// True for text that is safe in a name: only printable ASCII.
bool IsPlain(const std::string& text) {
  return !text.empty() && text.size() <= 253 &&
         std::all_of(text.begin(), text.end(), [](char c) { return c > ' ' && c < 127; });
}

std::vector<std::string> NamesOf(X509* certificate) {
  std::vector<std::string> names;
  const std::unique_ptr<GENERAL_NAMES, Freer<FreeNames>> all(static_cast<GENERAL_NAMES*>(
      X509_get_ext_d2i(certificate, NID_subject_alt_name, nullptr, nullptr)));
  for (int n = 0; all && n < sk_GENERAL_NAME_num(all.get()); ++n) {
    const GENERAL_NAME* name = sk_GENERAL_NAME_value(all.get(), n);
    if (name->type != GEN_DNS && name->type != GEN_URI && name->type != GEN_EMAIL) continue;
    // Uses the length, because a NUL inside would cut the text short.
    const ASN1_STRING* text = name->d.ia5;
    names.emplace_back(reinterpret_cast<const char*>(ASN1_STRING_get0_data(text)),
                       static_cast<std::size_t>(ASN1_STRING_length(text)));
    if (!IsPlain(names.back())) names.pop_back();
  }
  return names;
}

CertificateTime EndOf(STACK_OF(X509) * chain) {
  CertificateTime end = CertificateTime::max();
  for (int n = 0; n < sk_X509_num(chain); ++n) {
    end = std::min(end, ToTime(X509_get0_notAfter(sk_X509_value(chain, n))));
  }
  return end;
}

// Asks TLS itself whether keys and signatures are strong enough. Returns an empty text if they are.
std::string WhyTlsRefuses(const std::vector<Certificate>& chain, EVP_PKEY* key) {
  const TlsContext tls(SSL_CTX_new(TLS_server_method()));
  bool takes = SSL_CTX_use_certificate(tls.get(), chain.front().get()) == 1 &&
               SSL_CTX_use_PrivateKey(tls.get(), key) == 1;
  for (std::size_t n = 1; takes && n < chain.size(); ++n) {
    takes = SSL_CTX_add1_chain_cert(tls.get(), chain[n].get()) == 1;
  }
  if (takes) return "";
  const char* reason = ERR_reason_error_string(ERR_peek_last_error());
  ERR_clear_error();
  return std::string("is not fit for TLS: ") + (reason ? reason : "unknown reason");
}

// Leaves out everything else that the files hold.
std::string ToPem(const std::vector<Certificate>& chain, EVP_PKEY* key) {
  const Bio writer(BIO_new(BIO_s_mem()));
  PEM_write_bio_PKCS8PrivateKey(writer.get(), key, nullptr, nullptr, 0, nullptr, nullptr);
  for (const Certificate& certificate : chain) {
    PEM_write_bio_X509(writer.get(), certificate.get());
  }
  char* text = nullptr;
  const long length = BIO_get_mem_data(writer.get(), &text);
  return {text, static_cast<std::size_t>(length)};
}

[[noreturn]] void RefuseCertificate(const std::filesystem::path& path, const std::string& what) {
  throw Error(ErrorKind::kInvalidArgument, path.string() + " " + what);
}

Key LoadKey(const std::filesystem::path& path) {
  CheckKeyIsPrivate(path);
  const std::string pem = ReadFile(path);
  // Never asks the terminal for a passphrase.
  const auto no_passphrase = [](char*, int, int, void*) { return 0; };
  Key key(PEM_read_bio_PrivateKey(Reader(pem).get(), nullptr, no_passphrase, nullptr));
  ERR_clear_error();
  if (!key) RefuseCertificate(path, "holds no key in PEM, or one with a passphrase");
  return key;
}

// Loads a server's own certificate, valid at `now`, and the certificates between it and the
// authority.
std::vector<Certificate> LoadChain(const std::filesystem::path& path, CertificateTime now) {
  std::vector<Certificate> chain = ParseCertificates(ReadFile(path));
  if (chain.empty()) RefuseCertificate(path, "holds no certificate in PEM");
  X509* own = chain.front().get();
  if (now < ToTime(X509_get0_notBefore(own)))
    RefuseCertificate(path, "is not valid yet: check the clock");
  if (now > ToTime(X509_get0_notAfter(own))) {
    RefuseCertificate(path, "has expired: put a new one in its place");
  }
  if (X509_check_purpose(own, X509_PURPOSE_SSL_SERVER, 0) != 1) {
    RefuseCertificate(path, "is not one for servers");
  }
  return chain;
}

}  // namespace

CheckedPair CheckPair(const std::filesystem::path& certificate, const std::filesystem::path& key,
                      CertificateTime now) {
  const Key private_key = LoadKey(key);
  const std::vector<Certificate> chain = LoadChain(certificate, now);
  X509* own = chain.front().get();
  if (X509_check_private_key(own, private_key.get()) != 1) {
    ERR_clear_error();
    RefuseCertificate(
        key, "is not the key of " + certificate.string() + ": set the two that belong together");
  }
  const std::string problem = WhyTlsRefuses(chain, private_key.get());
  if (!problem.empty()) RefuseCertificate(certificate, problem);
  return {ToPem(chain, private_key.get()), SubjectOf(own), ToTime(X509_get0_notAfter(own))};
}

void CheckKey(const std::filesystem::path& key) { LoadKey(key); }

void CheckCertificate(const std::filesystem::path& certificate, CertificateTime now) {
  LoadChain(certificate, now);
}

ClientAuthority::ClientAuthority(const std::filesystem::path& ca_file)
    : store_(X509_STORE_new(), X509_STORE_free) {
  const std::vector<Certificate> roots = ParseCertificates(ReadFile(ca_file));
  for (const Certificate& root : roots) X509_STORE_add_cert(store_.get(), root.get());
  if (roots.empty()) {
    throw Error(ErrorKind::kInvalidArgument, ca_file.string() + " holds no certificate in PEM");
  }
}

ClientAuthority::Verdict ClientAuthority::Check(const Chain& chain, CertificateTime now) const {
  if (chain->size() > kLongestChain) {
    return {.problem = "its chain of certificates is longer than 32 KiB"};
  }
  // The emergency stop passes here, so nobody waits for the lock.
  if (const std::unique_lock lock(mutex_, std::try_to_lock); lock) {
    const auto found = verified_.find(*chain);
    if (found != verified_.end() && now <= found->second.valid_until) return found->second;
  }
  Verdict verdict = Verify(*chain, now);
  // A refusal is not remembered: the certificate may become valid when the clock is set.
  if (!verdict.problem.empty()) return verdict;
  verdict.chain = chain;
  if (const std::unique_lock lock(mutex_, std::try_to_lock); lock) {
    verified_.erase(*chain);
    if (verified_.size() >= kMostVerified) verified_.clear();
    verified_.emplace(*chain, verdict);
  }
  return verdict;
}

ClientAuthority::Verdict ClientAuthority::Verify(const std::string& chain_pem,
                                                 CertificateTime now) const {
  const std::vector<Certificate> sent = ParseCertificates(chain_pem);
  if (sent.empty()) return {.problem = "its certificate cannot be read"};
  const std::unique_ptr<STACK_OF(X509), Freer<FreeStack>> others(sk_X509_new_null());
  for (const Certificate& one : sent) {
    X509_up_ref(one.get());
    sk_X509_push(others.get(), one.get());
  }
  const std::unique_ptr<X509_STORE_CTX, Freer<X509_STORE_CTX_free>> context(X509_STORE_CTX_new());
  X509_STORE_CTX_init(context.get(), store_.get(), sent.front().get(), others.get());
  X509_STORE_CTX_set_purpose(context.get(), X509_PURPOSE_SSL_CLIENT);
  X509_STORE_CTX_set_time(context.get(), 0, std::chrono::system_clock::to_time_t(now));
  const bool good = X509_verify_cert(context.get()) == 1;
  ERR_clear_error();
  if (!good) {
    const int error = X509_STORE_CTX_get_error(context.get());
    return {.problem =
                std::string("its certificate is refused: ") + X509_verify_cert_error_string(error)};
  }
  return {{}, NamesOf(sent.front().get()), EndOf(X509_STORE_CTX_get0_chain(context.get()))};
}

}  // namespace palpate
