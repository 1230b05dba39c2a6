# How a header is shown to Doxygen: our comments are its documentation.
#   /* in the C header                        likewise
#   the block at the top                      describes the file
#   // before or behind a member              describes it
#   the sentences of fields()                 describe the members of a configuration struct
#   names_of, modules, destructors, moves     say the same everywhere
{ lines[NR] = $0 }

# The sentences of fields(): sentence["DqnConfig", "hidden_units"].
/^void fields\(/ { match($0, /\([A-Za-z]+/); config = substr($0, RSTART + 1, RLENGTH - 1) }
/^    fields\([a-z]+\.[a-z_]+, visit\);/ {
    match($0, /\.[a-z_]+/)
    sentence[config, substr($0, RSTART + 1, RLENGTH - 1)] = "Its members are keys beside the others."
}
/^    visit\(/ { call = "" }
/^    visit\(/, /\);$/ {
    call = call $0
    if ($0 ~ /\);$/) {
        match(call, /, [a-z]+\.[a-z0-9_]+/)
        member = substr(call, RSTART, RLENGTH)
        sub(/.*\./, "", member)
        sub(/^[^"]*"[^"]*"[^"]*"/, "", call)  # up to the sentence; its pieces stand in quotes
        sub(/"[^"]*$/, "", call)
        gsub(/" *"/, "", call)
        sentence[config, member] = call
    }
}

END {
    for (i = 1; i <= NR; ++i) {
        line = lines[i]
        if (line ~ /^#pragma once/) body = 1
        if (match(line, /^(struct|class) [A-Za-z]+/)) {
            struct = substr(line, RSTART, RLENGTH)
            sub(/.* /, "", struct)
        }
        if (!body) {
            if (line ~ /^\/\//) line = (i == 1 ? "/// \\file\n" : "") "/" line
        } else if (line ~ /^ *\/\/ /) {
            sub(/\/\/ /, "/// ", line)
        } else if (line ~ /^ *[^} \/].* \/\/ /) {
            sub(/ \/\/ /, " ///< ", line)
        } else if (line !~ /\/\/\// && previous !~ /^ *\/\/\/?( |$)/) {
            line = with_the_usual_words(line, lines[i + 1])
        }
        print for_doxygen(line)
        previous = lines[i]
    }
}

# Comments are plain text, and two members of one declaration share theirs.
function for_doxygen(line, text, type, names, count, i) {
    sub(/^\/\* /, "/** ", line)
    sub(/; +\/\* /, "; /**< ", line)
    if (line ~ /^ *\/\/\// && line !~ /\\file/) {
        gsub(/\\/, "\\\\\\\\", line)
        gsub(/<[a-z_]+>/, "`&`", line)
    }
    if (!match(line, /;  *\/\/\/< /) || line !~ /^ *[^ ,(]+ [^,(]+, [^(]*;  *\/\/\/</) return line
    text = substr(line, RSTART + 1)
    line = substr(line, 1, RSTART - 1)
    sub(/^ *\/\/\/< /, "", text)
    sub(/^ +/, "", line)
    type = line
    sub(/ .*/, "", type)
    sub(/^[^ ]+ /, "", line)
    count = split(line, names, ", ")
    line = "   "
    for (i = 1; i <= count; ++i) line = line " " type " " names[i] "; /**< " text " */"
    return line
}

# What needs no words of its own in the headers.
function with_the_usual_words(line, next_line, member) {
    if (line ~ /^template <class Visit>$/ && next_line ~ /^void fields\(/)
        return "/// Calls `visit` for every member: see cale/fields.h.\n" line
    if (line ~ /^std::span<const std::string_view> names_of\(.*;$/)
        return line " ///< The names of its values, in order."
    if (line ~ /^using [A-Za-z]+ = torch::nn::ModuleHolder<[A-Za-z]+>;$/)
        return line " ///< Made as the module is; copies share it."
    if (line ~ /^    (explicit )?[A-Za-z]+Impl\([a-zA-Z]/)
        return "    /// The initial values are drawn from `generator`.\n" line
    if (line ~ /^    static constexpr bool kDiscrete/)
        return line " ///< Whether it chooses among a set of actions; false: on the joystick."
    if (line ~ /^    static constexpr const char\* kName/)
        return line " ///< What error messages call the agent."
    if (line ~ /^    static constexpr const char\* kSizeSettings/)
        return line " ///< The settings that make its networks smaller."
    if (line ~ /^    bool operator==\(.*= default;$/) return line " ///< Compares member by member."
    if (line ~ /^ +~[A-Za-z]+\(\);$/) return line " ///< Frees what it holds."
    if (line ~ /^ +([A-Za-z]+& operator=|[A-Za-z]+)\([A-Za-z]+&&( other)?\) noexcept;/)
        return line " ///< Leaves the other empty."
    if (line ~ /^    [^(]*;$/ && line !~ /^ *(return|using|static)/) {
        member = line
        sub(/ = .*|\{.*|;.*/, "", member)
        sub(/.* /, "", member)
        if ((struct, member) in sentence) return line " ///< " sentence[struct, member]
    }
    return line
}
