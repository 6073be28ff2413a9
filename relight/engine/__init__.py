"""A scene under lights: at rest or with moving chunks, from captured or estimated albedo."""
