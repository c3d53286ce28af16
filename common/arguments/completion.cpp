#include "common/arguments/completion.h"

#include <vector>

namespace palpate::arguments {
namespace {

// The `case` clauses of the script. The path of a command is such as " edit sphere"; that of the
// program is "".
struct Clauses {
  std::string commands;  // which words lead from one command to another
  std::string words;  // words that may follow a command: its commands, and words of its arguments
  std::string options;
  std::string values;  // words that an option accepts; empty: file names
};

std::string Joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : " ") + word;
  return text;
}

void Append(const Command& command, const std::string& path, const std::string& common,
            Clauses& clauses) {
  std::vector<std::string> words, options;
  for (const auto& option : command.options()) {
    const std::string name = option->get_name();
    const std::vector<std::string>& values = option->suggested();
    if (!name.starts_with('-')) {
      words.insert(words.end(), values.begin(), values.end());
      continue;
    }
    options.push_back(name);
    if (option->takes_value()) {
      clauses.values += "    *\" " + name + "\") words=\"" + Joined(values) + "\" options= ;;\n";
    }
  }
  for (const auto& child : command.commands()) {
    words.push_back(child->name());
    clauses.commands += "      \"" + path + " " + child->name() + "\") path=\"$path $word\" ;;\n";
  }
  clauses.words += "    \"" + path + "\") words=\"" + Joined(words) + "\" options=\"" +
                   Joined(options) + " " + common + "\" ;;\n";
  for (const auto& child : command.commands()) {
    Append(*child, path + " " + child->name(), common, clauses);
  }
}

// The options of the program, which every command accepts, too.
std::string CommonOptions(const Command& program) {
  std::vector<std::string> names;
  for (const auto& option : program.options()) {
    if (option->get_name().starts_with('-')) names.push_back(option->get_name());
  }
  names.emplace_back("--help");
  return Joined(names);
}

}  // namespace

std::string CompletionScript(const Command& program) {
  Clauses clauses;
  Append(program, "", CommonOptions(program), clauses);
  const std::string name = program.name();
  const std::string function = "_" + name + "_words";
  return "# Completion of " + name + " for bash and zsh: source <(" + name + R"( completion)
if [ -n "${ZSH_VERSION-}" ]; then
  type compdef >/dev/null 2>&1 || { autoload -Uz compinit && compinit; }
  autoload -U +X bashcompinit && bashcompinit
fi
)" + function +
         R"(() {
  local current="${COMP_WORDS[COMP_CWORD]}" before="${COMP_WORDS[COMP_CWORD-1]}"
  local path="" words="" options="" word i
  for ((i = 1; i < COMP_CWORD; ++i)); do
    word="${COMP_WORDS[i]}"
    case "$path $word" in
)" + clauses.commands +
         R"(    esac
  done
  case "$path" in
)" + clauses.words +
         R"(  esac
  case "$path $before" in
)" + clauses.values +
         R"(  esac
  case "$current" in
    -*) words="$options" ;;
  esac
  COMPREPLY=($(compgen -W "$words" -- "$current"))
  if [ -z "$words" ]; then
    local IFS=$'\n'
    COMPREPLY=($(compgen -f -- "$current"))
  fi
}
complete -o filenames -F )" +
         function + " " + name + "\n";
}

}  // namespace palpate::arguments
