"""From a graph to flat hierarchies: rule programs, the table of states, flattening, layout."""
