"""The framework: messages, contracts, configuration, runtime. It knows no plugin by name."""
