"""The benchmarks behind `rcare-marl bench`: environments, people, homes, learning."""
