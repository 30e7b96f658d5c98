# What doxygen is given of a header (docs/site/Doxyfile): all but the tables of a message's fields, of a
# scenario's keys and of a memory's members. `messages/field.h`, `base/schema.h` and `law.h` say what they
# are. Lines keep their numbers.
/^ *static constexpr (std::string_view (type|suffix) =|auto fields|std::tuple (keys|members))/{
  :more
  /;$/!{
    N
    b more
  }
  s/[^\n]*//g
}
/^ *using Value = [A-Za-z]+;$/s/.*//
