// What TensorBoard is told: tags, numbers and a table of settings with any text in them. Input: lines
// "tag<TAB>eight bytes of a double". The records must come out whole, and what is in them short enough.
#include <cstring>
#include <iterator>
#include <map>
#include <vector>

#include "experiment/checksum.h"
#include "experiment/event_file.h"
#include "fuzz.h"

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
    fuzz::accepts([&] {
        cale::EventFile file(folder / "");
        path = file.path();
        file.write(static_cast<std::int64_t>(size), scalars);
        file.write_hyperparameters(settings);
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
    fuzz::require(records == (scalars.empty() ? 2 : 3), "a record is missing");
    return 0;
}
