#include "settings/yaml.h"

#include <algorithm>
#include <sstream>
#include <system_error>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <yaml-cpp/eventhandler.h>

#include "cale/text.h"
#include "settings/config.h"
#include "storage/files.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

/// The names of the configurations in a folder.
std::vector<std::string> configurations_in(const fs::path& folder) {
    std::vector<std::string> names;
    std::error_code ignored;
    for (const auto& item : fs::directory_iterator(folder, ignored)) {
        if (item.path().extension() == ".yaml") names.push_back(item.path().filename().string());
    }
    std::ranges::sort(names);
    return names;
}

/// "a.yaml, b.yaml", or the first few and how many there are.
std::string listed(std::vector<std::string> names) {
    constexpr std::size_t kMost = 6;
    const auto all = names.size();
    names.resize(std::min(all, kMost));
    return fmt::format("{}{}", fmt::join(names, ", "),
                       all > kMost ? fmt::format(", ... ({} in all)", all) : "");
}

/// `file`, such as configs/sac/200m.yaml, among what came with the program: in its source tree, or in
/// share/cale. Empty if it is not there.
std::string shipped(const fs::path& file) {
    if (file.is_absolute() || !file.has_parent_path()) return "";
    std::error_code ignored;
    const auto program = fs::read_symlink("/proc/self/exe", ignored);
    for (auto folder = program.parent_path(); folder != folder.parent_path(); folder = folder.parent_path()) {
        for (const auto& found : {folder / file, folder / "share/cale" / file})
            if (fs::is_regular_file(found, ignored)) return found.string();
    }
    return "";
}

/// The operating system's reason and the remedy: "No such file or directory; did you mean
/// 'configs/sac/200m.yaml'?", or what there is in the folder.
std::string unreadable(const fs::path& file, const std::error_code& reason) {
    std::string text = reason.message();
    if (reason == std::errc::is_a_directory) {
        const auto names = configurations_in(file);
        return names.empty() ? text : fmt::format("{}; give a file in it: {}", text, listed(names));
    }
    const auto folder = file.has_parent_path() ? file.parent_path() : fs::path(".");
    auto names = configurations_in(folder);
    std::erase(names, file.filename().string());
    std::string guess;
    if (reason == std::errc::no_such_file_or_directory) {
        guess = shipped(file);
        if (const auto close = nearest(file.filename().string(), names); guess.empty() && !close.empty())
            guess = (file.parent_path() / close).string();
    }
    if (!guess.empty()) {
        text += fmt::format("; did you mean '{}'?", guess);
    } else if (!names.empty()) {
        text += fmt::format("; '{}' has {}", folder.string(), listed(names));
    }
    return text;
}

/// What is said of a line that a tab indents, which the parser does not name; else nothing.
std::string hint_of_tabs(const std::string& text) {
    const auto lines = split(text, '\n');
    const auto found = std::ranges::find_if(lines, [](const auto& line) {
        return line.substr(0, line.find_first_not_of(" \t")).find('\t') != line.npos;
    });
    if (found == lines.end()) return "";
    return fmt::format("; a tab indents line {}: YAML wants spaces", found - lines.begin() + 1);
}

/// Where the documents of a YAML stream begin, and its last scalar.
struct DocumentStarts : YAML::EventHandler {
    std::vector<YAML::Mark> marks;
    YAML::Mark last_scalar;

    void OnDocumentStart(const YAML::Mark& mark) override { marks.push_back(mark); }
    void OnDocumentEnd() override {}
    void OnNull(const YAML::Mark&, YAML::anchor_t) override {}
    void OnAlias(const YAML::Mark&, YAML::anchor_t) override {}
    void OnScalar(const YAML::Mark& mark, const std::string&, YAML::anchor_t, const std::string&) override {
        last_scalar = mark;
    }
    void OnSequenceStart(const YAML::Mark&, const std::string&, YAML::anchor_t,
                         YAML::EmitterStyle::value) override {}
    void OnSequenceEnd() override {}
    void OnMapStart(const YAML::Mark&, const std::string&, YAML::anchor_t,
                    YAML::EmitterStyle::value) override {}
    void OnMapEnd() override {}
};

/// Whether valid YAML ends within quotes, which the parser closes by itself.
bool leaves_a_quote_open(const std::string& text) {
    try {
        YAML::Load(text + "\n...\n");  // which ends a document, but not within quotes
    } catch (const YAML::Exception&) {
        return true;
    }
    return false;
}

}  // namespace

std::string read_yaml(const fs::path& file) {
    try {
        return read_file(file);
    } catch (const std::system_error& error) {
        throw ConfigError(fmt::format("cannot read '{}': {}", file.string(), unreadable(file, error.code())));
    } catch (const std::runtime_error& error) {
        throw ConfigError(error.what());
    }
}

std::string place(const fs::path& file, const YAML::Mark& mark) {
    if (mark.is_null()) return file.string();
    return fmt::format("{}:{}:{}", file.string(), mark.line + 1, mark.column + 1);
}

void fail_at(const fs::path& file, const YAML::Mark& mark, std::string_view what) {
    throw ConfigError(fmt::format("{}: {}", place(file, mark), what));
}

YAML::Node parse_yaml(const std::string& text) {
    DocumentStarts starts;
    YAML::Node document;
    try {
        std::istringstream stream(text);
        YAML::Parser parser(stream);
        // Not YAML::LoadAll(), which on some malformed files takes empty documents for ever.
        while (starts.marks.size() < 2 && parser.HandleNextDocument(starts)) {
        }
        document = YAML::Load(text);
    } catch (const YAML::Exception& error) {
        throw YAML::Exception(error.mark, "not valid YAML: " + error.msg + hint_of_tabs(text));
    }
    if (leaves_a_quote_open(text))
        throw YAML::Exception(starts.last_scalar, "not valid YAML: a quote is opened here and not closed");
    if (starts.marks.size() > 1)
        throw YAML::Exception(starts.marks[1], "a second YAML document ('---'); a file may hold one only");
    return document;
}

YAML::Node parse_yaml(const fs::path& file, const std::string& text) {
    try {
        return parse_yaml(text);
    } catch (const YAML::Exception& error) {
        fail_at(file, error.mark, error.msg);
    }
}

}  // namespace cale
