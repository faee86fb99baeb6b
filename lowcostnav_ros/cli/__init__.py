"""The ``lowcostnav`` command: :mod:`.main`, and one file a job."""
