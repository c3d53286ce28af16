"""What every list of the contract is read with."""

import typing

from google.protobuf import descriptor_pool, message_factory


class Fault(Exception):
    """What is wrong with the contract, for who changed it."""


def option(request: typing.Any, kind: str, name: str) -> typing.Callable[[typing.Any], typing.Any]:
    """Reads the option `name` off what has options of `kind`; None: it has none. This program is not
    built with the options, but is told of them."""
    pool = descriptor_pool.DescriptorPool()
    for file in request.proto_file:
        pool.AddSerializedFile(file.SerializeToString())
    types = message_factory.MessageFactory(pool).GetMessages(
        [file.name for file in request.proto_file])
    options = types[f"google.protobuf.{kind}"]
    try:
        extension = pool.FindExtensionByName(f"palpate.v1.{name}")
    except KeyError:  # no file to generate uses it
        return lambda declared: None

    def of(declared: typing.Any) -> typing.Any:
        found = options.FromString(declared.options.SerializeToString())
        return found.Extensions[extension] if found.HasExtension(extension) else None
    return of


def comments(file: typing.Any) -> dict[tuple[int, ...], str]:
    """The comments above what is declared, by its place in the file."""
    return {tuple(place.path): " ".join(place.leading_comments.split())
            for place in file.source_code_info.location if place.leading_comments}
