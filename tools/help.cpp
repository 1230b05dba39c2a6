#include "tools/help.h"

#include <string>

#include <fmt/format.h>

#include "terminal/columns.h"

namespace cale {
namespace {

constexpr std::size_t kColumn = 28;

class Formatter : public CLI::Formatter {
  public:
    std::string make_option(const CLI::Option* option, bool positional) const override {
        std::string left = positional ? option->get_name(true) : option->get_name(false, true);
        if (!positional && option->get_type_size() != 0) left += fmt::format(" {}", option->get_type_name());
        std::string right = option->get_description();
        const std::string& otherwise = option->get_default_str();
        if (!otherwise.empty() && otherwise != "false") right += fmt::format(" [default {}]", otherwise);
        return two_columns(left, right, kColumn, terminal_width());
    }
    std::string make_subcommand(const CLI::App* command) const override {
        const std::string& about = command->get_description();
        auto sentence = about.substr(0, about.find(". "));
        if (sentence.ends_with('.')) sentence.pop_back();
        return two_columns(command->get_name(), sentence, kColumn, terminal_width());
    }
    std::string make_description(const CLI::App* app) const override {
        return wrap(app->get_description(), 0, terminal_width()) + "\n";
    }
};

}  // namespace

std::shared_ptr<CLI::FormatterBase> help_formatter() {
    return std::make_shared<Formatter>();
}

}  // namespace cale
