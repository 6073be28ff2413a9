"""What takes seconds in every command and every scene, made small: no test looks at it at large."""


def shrink(set_attribute):
    """Set constants, by `set_attribute(module, name, value)`.

    Textures are asked for by the tests that look at them. Pictures that commands write beside their results take a
    second each in full size. Plans are measured on every scene. To find the camera positions takes 640,000 rays, of
    which a twelfth distinguish a room from an object as well.
    """
    import relight.jobs.results
    import relight.jobs.writer
    import relight.output.catcher
    import relight.planning.unmeasured
    import splat2mesh.cli
    import splat2mesh.render.beside
    import splat2mesh.views.standpoints

    set_attribute(splat2mesh.cli, "DEFAULT_TEXTURE", "none")
    set_attribute(splat2mesh.render.beside, "WIDTH", 96)
    set_attribute(splat2mesh.views.standpoints, "PLACES", 500)
    set_attribute(splat2mesh.views.standpoints, "EVENLY", 96)
    set_attribute(relight.output.catcher, "SIDE", 32)
    set_attribute(relight.output.catcher, "DIRECTIONS", 64)
    set_attribute(relight.jobs.results, "PICTURE_SIZE", (96, 72))
    set_attribute(relight.jobs.writer, "PICTURE_SIZE", (96, 72))
    set_attribute(relight.planning.unmeasured, "UNMEASURED_VERTICES", 0)
