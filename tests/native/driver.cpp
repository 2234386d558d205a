// Calls the exported functions with recorded inputs, for sanitizers: every array is an allocation
// of its own, of its own size. Fails if a result is no number.
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <memory>
#include <string>
#include <tuple>
#include <type_traits>
#include <vector>

#include "exports.h"  // made by test_library.py: what the sources declare, and EXPORTS

static std::vector<void*> programs;

static void require(bool holds, const char* what) {
    if (holds) return;
    std::fprintf(stderr, "%s\n", what);
    std::exit(1);
}

struct Input {
    std::ifstream file;
    const char* name = "";

    template <typename T>
    void read(T* to, integer count) {
        file.read(reinterpret_cast<char*>(to), count * sizeof(T));
        require(!file.fail(), "the inputs end within a call");
    }

    template <typename T>
    T one() {
        T value;
        read(&value, 1);
        return value;
    }
};

template <typename T>
struct Given {
    T value;
    explicit Given(Input& input) : value(input.one<T>()) {}
    T get() { return value; }
    void check(const char*) {}
};

template <>
struct Given<void*> {
    integer which;
    explicit Given(Input& input) : which(input.one<integer>()) {}
    void* get() { return programs.at(which); }
    void check(const char*) {}
};

template <typename T>
struct Given<T*> {
    using Value = std::remove_const_t<T>;
    integer count;  // -1: null, of which the driver may not see a result
    std::unique_ptr<Value[]> values;

    explicit Given(Input& input) : count(input.one<integer>()) {
        if (count < 0) return;
        values.reset(new Value[count]);
        if (input.one<integer>())
            input.read(values.get(), count);
        else  // what the function must set
            for (integer k = 0; k < count; ++k)
                values[k] = std::is_same_v<Value, double> ? Value(NAN) : Value();
    }
    T* get() { return values.get(); }
    void check(const char* name) {
        if constexpr (std::is_same_v<T, double>)
            for (integer k = 0; k < count; ++k) require(!std::isnan(values[k]), name);
    }
};

template <>
struct Given<const Shapes*> {
    integer count;
    Given<const integer*> body, begin, size;
    Given<const double*> points, radius, center, reach, axes, middle, half;
    Shapes shapes;

    explicit Given(Input& input)
        : count(input.one<integer>()), body(input), begin(input), size(input), points(input),
          radius(input), center(input), reach(input), axes(input), middle(input), half(input) {}
    const Shapes* get() {
        shapes = {count, body.get(), begin.get(), size.get(), points.get(), radius.get(),
                  center.get(), reach.get(), axes.get(), middle.get(), half.get()};
        return &shapes;
    }
    void check(const char*) {}
};

template <typename R, typename... A>
static void call(R (*function)(A...), Input& input) {
    std::tuple<Given<A>...> given{Given<A>(input)...};
    std::apply(
        [&](auto&... each) {
            if constexpr (std::is_same_v<R, void*>)
                programs.push_back(function(each.get()...));
            else
                function(each.get()...);
            (each.check(input.name), ...);
        },
        given);
}

int main(int, char** arguments) {
    Input input{std::ifstream(arguments[1], std::ios::binary)};
    integer calls = 0;
    for (; input.file.peek() != EOF; ++calls) {
        std::string name(input.one<integer>(), ' ');
        input.read(name.data(), name.size());
        input.name = name.c_str();
        bool is_known = false;
#define CALL_IF(function) \
    if (name == #function) is_known = true, call(function, input);
        EXPORTS(CALL_IF)
        require(is_known, input.name);
    }
    std::printf("%lld calls\n", static_cast<long long>(calls));
}
