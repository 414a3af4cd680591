"""A process of `pcsg view` that is made up: it hears everything, and says what tests tell it."""


class Made:
    def __init__(self, path, limits, receive):
        self.receive, self.heard, self.ended, self.memory = receive, [], False, 0

    def send(self, message):
        self.heard.append(message)

    def words(self):
        return [message.word for message in self.heard]

    def redirect(self, receive):
        self.receive = receive

    def end(self):
        self.ended = True
