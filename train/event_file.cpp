#include "train/event_file.h"

#include <fmt/format.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <stdexcept>

#include "policy/json.h"
#include "storage/checksum.h"
#include "tensorboard_event.pb.h"

namespace cale {
namespace {

template <class Integer>
void append_little_endian(std::string& out, Integer value) {
    for (std::size_t i = 0; i < sizeof value; ++i) out.push_back(static_cast<char>(value >> (8 * i) & 0xFF));
}

/// TFRecord files mask their checksums, so that a checksum of data that itself holds
/// checksums stays meaningful.
std::uint32_t masked_crc32c(std::string_view bytes) {
    const std::uint32_t crc = crc32c(bytes);
    return ((crc >> 15) | (crc << 17)) + 0xA282EAD8u;
}

double unix_time() {
    return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

std::filesystem::path unused_path(const std::filesystem::path& folder) {
    std::array<char, 256> host{};
    if (::gethostname(host.data(), host.size() - 1) != 0 || host[0] == '\0') host = {"localhost"};
    const auto stem =
        fmt::format("events.out.tfevents.{:010.0f}.{}.{}", unix_time(), host.data(), ::getpid());
    for (int number = 0;; ++number) {
        auto path = folder / fmt::format("{}.{}", stem, number);
        if (!std::filesystem::exists(path)) return path;
    }
}

tensorboard::Event event_at(std::int64_t step) {
    tensorboard::Event event;
    event.set_wall_time(unix_time());
    event.set_step(step);
    return event;
}

/// TensorBoard refuses a whole file for one text that is not.
void check_utf8(std::string_view text) {
    if (!is_utf8(text))
        throw std::runtime_error(fmt::format(
            "TensorBoard cannot show {}: it is not UTF-8; rename that metric or setting", in_quotes(text)));
}

/// Makes a cell of a Markdown table hold any text.
std::string escaped(std::string_view text) {
    std::string out;
    for (const char c : text) {
        if (c == '|' || c == '\\' || c == '*' || c == '_' || c == '`' || c == '<') out.push_back('\\');
        out.push_back(c == '\n' ? ' ' : c);
    }
    return out;
}

}  // namespace

std::string tf_record(std::string_view bytes) {
    std::string record;
    append_little_endian(record, std::uint64_t{bytes.size()});
    append_little_endian(record, masked_crc32c(record));
    record.append(bytes);
    append_little_endian(record, masked_crc32c(bytes));
    return record;
}

EventFile::EventFile(const std::filesystem::path& folder, std::optional<std::int64_t> resumed_step)
    : file_(unused_path(folder)) {
    auto version = event_at(0);
    version.set_file_version("brain.Event:2");
    file_.write(tf_record(version.SerializeAsString()));
    if (!resumed_step) return;
    auto start = event_at(*resumed_step + 1);  // TensorBoard voids this step and all after it
    start.mutable_session_log()->set_status(1);
    file_.write(tf_record(start.SerializeAsString()));
}

void EventFile::write(std::int64_t global_step, const std::map<std::string, double>& scalars) {
    if (scalars.empty()) return;
    auto event = event_at(global_step);
    for (const auto& [tag, number] : scalars) {
        check_utf8(tag);
        auto& value = *event.mutable_summary()->add_value();
        value.set_tag(tag);
        value.set_simple_value(static_cast<float>(number));
    }
    file_.write(tf_record(event.SerializeAsString()));
}

void EventFile::write_hyperparameters(std::span<const std::pair<std::string, std::string>> values) {
    std::string table = "|name|value|\n|-|-|";
    for (const auto& [name, text] : values) {
        check_utf8(name);
        check_utf8(text);
        table += fmt::format("\n|{}|{}|", escaped(name), escaped(text));
    }
    auto event = event_at(0);
    auto& value = *event.mutable_summary()->add_value();
    value.set_tag("hyperparameters/text_summary");
    value.mutable_metadata()->mutable_plugin()->set_name("text");
    value.mutable_metadata()->set_data_class(2);
    value.mutable_tensor()->set_type(7);
    value.mutable_tensor()->mutable_shape()->add_dimension()->set_size(1);
    value.mutable_tensor()->add_strings(table);
    file_.write(tf_record(event.SerializeAsString()));
}

}  // namespace cale
