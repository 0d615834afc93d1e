pytest_plugins = ["syncwatch.testing.plugin"]
