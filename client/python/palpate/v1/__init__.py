"""Messages and stubs of the wire contract, written by protoc when the package is built.

For what the package itself does not offer: proto/palpate/v1 documents them.
"""
