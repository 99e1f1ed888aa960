"""Functions of a drive for tests of its register: they note calls and set fields of a record."""


class DriveFunctions:
    """Notes executed commands; ``permits`` is what the state of the drive returns to each of them."""

    def __init__(self, record, permits=True):
        self._record, self.permits = record, permits
        self.calls = []

    def start_procedure(self, procedure):
        self.calls.append(procedure)
        return self.permits

    def cancel_procedure(self):
        self.calls.append('cancel')

    def set_data(self, name, value):
        if self.permits:
            self._record[name] = value
        return self.permits
