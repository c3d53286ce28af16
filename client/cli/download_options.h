// The options of `palpate download`.
#pragma once

#include "client/cli/download_command.h"
#include "client/cli/invocation.h"

namespace palpate::cli {

// `options` is to outlive the parse and the command.
void AddDownload(arguments::Command& app, Invocation& invocation, DownloadOptions& options);

}  // namespace palpate::cli
