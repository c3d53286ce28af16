"""A certificate authority for tests."""

import pathlib
import subprocess


class Authority:
    """Certificates made for a test, by the openssl program."""

    def __init__(self, folder, name):
        self.folder = pathlib.Path(folder)
        self.ca = self.folder / f"{name}-ca.pem"
        self._ca_key = self.folder / f"{name}-ca.key"
        self._openssl("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256",
                      "-nodes", "-keyout", self._ca_key, "-out", self.ca, "-days", "30",
                      "-subj", f"/CN={name}")

    def _openssl(self, *arguments):
        subprocess.run(["openssl", *map(str, arguments)], check=True, capture_output=True)

    def issue(self, name, san, days=30, purpose="clientAuth"):
        """Paths of certificate and key. days=-1: expired."""
        base = self.folder / name
        key, request, certificate = (base.with_suffix(s) for s in (".key", ".csr", ".pem"))
        extensions = base.with_suffix(".ext")
        extensions.write_text(f"subjectAltName={san}\nextendedKeyUsage={purpose}\n")
        self._openssl("req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes",
                      "-keyout", key, "-out", request, "-subj", f"/CN={name}")
        self._openssl("x509", "-req", "-in", request, "-CA", self.ca, "-CAkey", self._ca_key,
                      "-CAcreateserial", "-out", certificate, "-days", days, "-extfile", extensions)
        key.chmod(0o600)
        return certificate, key

    def revoke(self, certificate):
        """The path of a list with it."""
        index, config = self.folder / "index.txt", self.folder / "ca.cnf"
        index.touch()
        config.write_text(f"[ca]\ndefault_ca=own\n[own]\ndatabase={index}\n"
                          "default_md=sha256\ndefault_crl_days=30\n")
        ours = ["ca", "-config", config, "-cert", self.ca, "-keyfile", self._ca_key]
        self._openssl(*ours, "-revoke", certificate)
        self._openssl(*ours, "-gencrl", "-out", self.folder / "crl.pem")
        return self.folder / "crl.pem"
