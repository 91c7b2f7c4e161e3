// A target needs a source; what is compiled is headers.hpp.
