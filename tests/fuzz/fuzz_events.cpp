// What TensorBoard is told: tags, numbers and a table of settings with any text in them. Input: lines
// "tag<TAB>eight bytes of a double", where the eight bytes are a setting's text too. The records must come
// out whole, and without any text that is not UTF-8, which TensorBoard cannot read.
#include <algorithm>
#include <cstring>
#include <iterator>
#include <map>
#include <vector>

#include "fuzz.h"
#include "policy/json.h"
#include "storage/checksum.h"
#include "train/event_file.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    static const fuzz::Folder folder;
    auto input = fuzz::text_of(data, size);
    std::map<std::string, double> scalars;
    std::vector<std::pair<std::string, std::string>> settings;
    while (!input.empty()) {
        const std::string tag(fuzz::take(input, input.find('\t')));
        fuzz::take(input, 1);
        const auto bytes = fuzz::take(input, sizeof(double));
        double value = 0;
        std::memcpy(&value, bytes.data(), bytes.size());
        scalars[tag] = value;
        settings.emplace_back(tag, bytes);
    }
    std::filesystem::path path;
    std::size_t accepted = 1;  // the version
    fuzz::accepts([&] {
        cale::EventFile file(folder / "");
        path = file.path();
        const auto written = [&](const auto& write) { accepted += fuzz::accepts(write) ? 1 : 0; };
        if (!scalars.empty()) written([&] { file.write(static_cast<std::int64_t>(size), scalars); });
        written([&] { file.write_hyperparameters(settings); });
    });
    std::ifstream stream(path, std::ios::binary);
    const std::string contents{std::istreambuf_iterator<char>(stream), {}};
    std::filesystem::remove(path);
    std::size_t records = 0;
    for (std::string_view rest = contents; !rest.empty(); ++records) {
        std::uint64_t length = 0;
        fuzz::require(rest.size() >= 16, "half a record");
        std::memcpy(&length, rest.data(), sizeof length);
        fuzz::require(rest.size() >= length + 16, "half a record");
        fuzz::require(cale::tf_record(rest.substr(12, length)) == rest.substr(0, length + 16),
                      "a wrong checksum");
        rest.remove_prefix(length + 16);
    }
    fuzz::require(records == accepted, "a record is missing, or one that was refused is there");
    const bool tags_can_be_shown =
        std::ranges::all_of(scalars, [](const auto& scalar) { return cale::is_utf8(scalar.first); });
    const bool settings_can_be_shown = std::ranges::all_of(settings, [](const auto& setting) {
        return cale::is_utf8(setting.first) && cale::is_utf8(setting.second);
    });
    std::size_t due = 1;
    if (!scalars.empty() && tags_can_be_shown) ++due;
    if (settings_can_be_shown) ++due;
    fuzz::require(accepted == due, "UTF-8 was refused, or what is none was not");
    return 0;
}
